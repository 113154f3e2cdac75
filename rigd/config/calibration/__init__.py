"""Reads and writes the calibration of a rig."""
