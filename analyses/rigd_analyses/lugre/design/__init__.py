"""Designs tests of the omni-wheel rig: current shapes, their motion and information."""
