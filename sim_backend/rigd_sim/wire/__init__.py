"""Devices simulated at the wire: protocol servers of their own, connected to a plant."""
