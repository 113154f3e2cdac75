"""Puts the times of a table in order."""
