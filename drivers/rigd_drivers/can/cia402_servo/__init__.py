"""Controls CiA 402 servo drives over CAN: in current mode, and in speed mode for belt axes."""
