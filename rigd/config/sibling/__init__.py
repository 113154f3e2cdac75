"""Finds the rig that a folder states, and compares a rig with its simulated sibling."""
