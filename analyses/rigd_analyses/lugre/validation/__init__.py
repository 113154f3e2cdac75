"""Tries identified friction on other recordings: current in; speed, slip and force out.

Section 3.2 and Table II of the paper, with the slip that the paper leaves out: the speed follows
from current and mass almost alone and hardly separates one floor from another (lugre.md section 6).
"""
