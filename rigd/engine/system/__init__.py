"""Starts and ends processes, and sets their priority and processor."""
