"""Contains the commands that compute results from recordings."""
