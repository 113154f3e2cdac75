"""Hosts the cycle in the process of the run, or in one of its own."""
