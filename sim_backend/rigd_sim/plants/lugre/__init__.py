"""The friction rig of the omni-wheel: carriage, wheel, drive, floor, belts and sensors."""
