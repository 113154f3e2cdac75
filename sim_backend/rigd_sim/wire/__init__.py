"""Simulates devices at the wire: each serves its own protocol and is connected to a plant."""
