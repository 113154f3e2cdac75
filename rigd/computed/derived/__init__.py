"""Channels that the cycle computes from other channels: formulas, their graph, its kernel."""
