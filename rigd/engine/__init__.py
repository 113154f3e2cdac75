"""Runs procedures on a rig: the control cycle, its interlocks and limits, and the run itself."""
