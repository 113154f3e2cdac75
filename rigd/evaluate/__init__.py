"""Recordings to arrays to an identification to a report."""
