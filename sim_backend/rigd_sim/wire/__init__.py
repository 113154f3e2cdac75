"""Devices simulated at the wire: their own protocol servers, connected to a plant."""
