"""Checks plants: their declarations, time, noise and physics."""
