"""A relay on a digital line of an NI card, behind a one-shot that this computer retriggers."""

from rigd_drivers.ni_relay.driver import NiRelay

__all__ = ["NiRelay"]
