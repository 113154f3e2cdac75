"""Serves the operator's panel, a web page, from a process that is a client of the daemon."""
