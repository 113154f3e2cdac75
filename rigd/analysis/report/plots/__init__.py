"""Draws the figures of a report with matplotlib, from typed results."""
