"""Simulates rigs: a folder for each family (plant, devices, wire); all share ``wire``."""
