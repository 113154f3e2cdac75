"""Builds a rig from its rig file and runs procedures on it (composition root of the program)."""
