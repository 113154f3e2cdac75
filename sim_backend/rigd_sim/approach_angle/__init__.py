"""Simulates the approach-angle rig.

The rig has a motor, a shaft, an omni-wheel, its contact, a platform, and their sensors.
"""
