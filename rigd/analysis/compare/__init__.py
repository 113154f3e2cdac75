"""Compares campaigns: differences of their numbers with intervals, tests, trends, curves.

:mod:`.statistics` computes from arrays, :mod:`.campaign` reads recordings and results,
:mod:`.comparison` puts both together, :mod:`.evaluation` shows it.
"""
