"""Recordings to arrays to an identification to a report.

Import :mod:`rigd.analysis.evaluation` to evaluate, :mod:`rigd.analysis.models` for what each model
needs; this package itself imports nothing, so that checking a plan stays fast.
"""
