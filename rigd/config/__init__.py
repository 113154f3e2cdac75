"""Reads rig files: YAML to typed objects, with errors as file:line:column.

Import :mod:`rigd.config.loader` to read a rig file. This package itself imports nothing, because
each process of a run imports only :mod:`rigd.config.rig` and reads no file.
"""
