"""Procedure files: read, checked, compiled to cycle programs.

Import :mod:`rigd.procedure.loader` to read one, :mod:`rigd.procedure.compile` to compile it. This
package itself imports nothing: who plays a program needs :mod:`rigd.procedure.program` alone.
"""
