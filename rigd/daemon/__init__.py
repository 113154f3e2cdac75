"""Composition root: builds a rig from its file and runs procedures on it."""
