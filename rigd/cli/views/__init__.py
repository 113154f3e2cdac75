"""Prints at a terminal, or returns as JSON, what commands have found."""
