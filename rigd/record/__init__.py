"""Recordings: MCAP written in bulk, read in columns, recovered in place, exported."""
