"""Provides the clients of a daemon, for programs, the command line and the panel.

The package itself imports nothing: a stop needs a small part of it.
"""
