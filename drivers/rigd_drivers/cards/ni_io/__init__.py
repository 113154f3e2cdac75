"""Operates an NI card as a link: analogue inputs and outputs, counters and lines in one cycle."""

from rigd_drivers.cards.ni_io.link import NiIo

__all__ = ["NiIo"]
