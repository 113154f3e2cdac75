"""Controllers: a measured channel is held at its setpoint by a setpoint of a device (PID)."""
