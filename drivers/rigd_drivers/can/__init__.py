"""Drivers of devices on a CAN bus, and the bus itself."""
