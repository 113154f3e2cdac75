"""Reads recordings: rows as columns, tables, trials, summaries."""
