"""Simulates the LuGre rig for omni-wheels: carriage, wheel, drive, floor, belts and sensors."""
