"""Estimates slip in every cycle from the encoder of the motor, an accelerometer and the current."""
