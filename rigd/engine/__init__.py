"""The engine: the control cycle, interlocks, limits, and the run that plays a procedure."""
