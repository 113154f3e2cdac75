"""Reads analogue inputs of an NI card through NI-DAQmx; the card samples by its own clock."""

from rigd_drivers.cards.ni_daq.driver import NiDaq

__all__ = ["NiDaq"]
