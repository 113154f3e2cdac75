"""Holds the MCAP format as bytes: records, chunks, the index, the file and its locks."""
