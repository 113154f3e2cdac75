"""Operates a LabJack T7 or T4 over Modbus TCP as a link that devices share."""

from rigd_drivers.cards.labjack.link import Labjack

__all__ = ["Labjack"]
