"""Decodes the messages of each topic to rows of numbers."""
