"""Simulates devices without a wire: drivers that read and command the plant in the same process."""
