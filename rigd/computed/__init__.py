"""Computes in the cycle what no device gives: derived channels, controllers, observers."""
