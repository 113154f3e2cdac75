"""Reads the map that describes what the files of another program mean."""
