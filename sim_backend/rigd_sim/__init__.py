"""The simulated rig: plants (physics) and the devices that stand on them."""
