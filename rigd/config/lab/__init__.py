"""Reads what a lab demands of every run, and what a publication of data states."""
