"""Finds a rig by name: the client's list, its address and its credentials."""
