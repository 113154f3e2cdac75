"""Simulates CAN devices: a bus that several processes can join, and CANopen nodes on the bus."""
