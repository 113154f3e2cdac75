"""The LuGre omni-wheel rig: slip and traction of a driven carriage to friction parameters."""
