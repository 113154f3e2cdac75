"""Prepares the trials of the omni-wheel rig: known constants, samples, slip and traction."""
