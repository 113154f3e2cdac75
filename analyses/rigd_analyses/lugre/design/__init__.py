"""Designs tests of the omni-wheel rig: shapes of the current, their motion, what they notify."""
