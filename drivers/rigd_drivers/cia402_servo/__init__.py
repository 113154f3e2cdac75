"""Servo drives of CiA 402 over CAN: in current mode, and in speed mode for belt axes."""
