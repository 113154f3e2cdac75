"""Analogue inputs of an NI card, sampled by the card's own clock through NI-DAQmx."""

from rigd_drivers.ni_daq.driver import NiDaq

__all__ = ["NiDaq"]
