"""Checks drivers that the control cycle calls in each cycle."""
