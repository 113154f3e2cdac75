"""Writes recordings, and adds to finished ones."""
