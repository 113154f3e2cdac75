"""Contains the commands that read, repair, list and convert recordings."""
