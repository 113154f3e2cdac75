"""Instruments of PyMeasure: its classes read and set them, in a process of their own."""
