"""Simulates rigs: the physics (plants) and the devices."""
