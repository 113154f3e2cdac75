"""Evaluates a campaign: its sets, their trend over the approach angle, slip and stops."""
