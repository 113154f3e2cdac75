"""Reads any device that sends lines of numbers, as the rig file describes them."""
