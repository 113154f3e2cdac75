"""Covers what differs between machines: systems, processes, folders, libraries, compilation."""
