"""Finds the coupling of lateral motion to guide and bearings, across the kinks of its loads."""
