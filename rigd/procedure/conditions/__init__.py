"""Reads the conditions that end a step, and prints them."""
