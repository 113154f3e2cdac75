"""Reads and checks procedure files, and compiles them to programs that the control cycle plays.

Import :mod:`rigd.procedure.loader` to read a file, :mod:`rigd.procedure.compile` to compile it.
This package itself imports nothing, because the cycle needs only :mod:`rigd.procedure.program`.
"""
