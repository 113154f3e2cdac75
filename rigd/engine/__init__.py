"""What moves the rig: the cycle, its interlocks and limits, and the run that drives it."""
