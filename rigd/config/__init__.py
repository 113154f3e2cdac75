"""Rig files: YAML with positions to typed objects, errors as file:line:column.

Import :mod:`rigd.config.loader` to read one. This package itself imports nothing: each process of
a run takes :mod:`rigd.config.rig` alone, and reads no file.
"""
