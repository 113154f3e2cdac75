"""Verifies recordings, and repairs damaged ones."""
