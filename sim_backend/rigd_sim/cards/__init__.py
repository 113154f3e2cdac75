"""Simulates data acquisition cards at register level, and the wiring between card and rig."""
