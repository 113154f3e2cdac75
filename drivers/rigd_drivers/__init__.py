"""Contains the drivers of real devices."""
