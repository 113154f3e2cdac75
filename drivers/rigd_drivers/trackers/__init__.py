"""Drivers of cameras and trackers."""
