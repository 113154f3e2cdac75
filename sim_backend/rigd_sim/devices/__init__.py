"""Devices simulated in process: drivers whose link is the plant itself."""
