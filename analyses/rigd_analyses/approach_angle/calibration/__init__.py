"""Computes the calibrated values of the approach-angle rig from the recordings of calibrations.

The values, each with its uncertainty, are:

- the torque per volt of the strain gauges;
- the ratio of true to indicated load of the scale;
- the normal force per volt of the fast load cell, and its zero;
- the friction of the platform's rails and of the wheel's bearings;
- the rise of the load along the travel of the platform.
"""
