"""Simulates data acquisition cards by their registers or their server, and their wires."""
