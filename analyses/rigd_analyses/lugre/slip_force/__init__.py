"""Identifies friction from slip and traction of each trial (method A of the paper)."""
