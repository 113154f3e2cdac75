"""Runs the control cycle: read, compute, limit, write, record."""
