"""Dry run: a compiled procedure played on the simulated plant, nothing recorded."""
