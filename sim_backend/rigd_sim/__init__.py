"""The simulated rig: plants (physics) and simulated devices."""
