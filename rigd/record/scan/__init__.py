"""Checks every byte of a file, and finds what is intact in a damaged one."""
