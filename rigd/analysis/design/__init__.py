"""Chooses tests by information, and writes them as a procedure."""
