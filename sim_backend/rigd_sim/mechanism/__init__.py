"""Simulates a rig that a file describes: bodies, connections, friction, drives, sensors."""
