"""Calibration of the approach-angle rig: torque, scale, friction of rails and bearings, rise."""
