"""Simulated cards at register level, and their wiring."""
