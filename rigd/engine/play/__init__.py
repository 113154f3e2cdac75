"""Plays a program: steps, pauses, conditions, interlocks, requests."""
