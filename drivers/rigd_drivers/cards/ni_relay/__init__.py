"""Switches a relay on a digital line of an NI card, behind a one-shot.

The one-shot is a retriggerable monostable with its contact in series with the relay's coil. The
contact opens when this computer no longer sends pulses.
"""

from rigd_drivers.cards.ni_relay.driver import NiRelay

__all__ = ["NiRelay"]
