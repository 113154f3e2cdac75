"""Reads what the cycle computes: derived channels, controllers, observers."""
