"""Defines the base class of simulated sensors that read a plant; clips setpoints to their range."""

from __future__ import annotations

from rigd.model.channels import Channel
from rigd.model.errors import DeviceError
from rigd.sdk.driver import ConfigT, Driver, LinkT


class PlantSensor(Driver[ConfigT, LinkT]):
    """A simulated device that takes no setpoints; safe at all times. An author writes ``read``."""

    def open(self) -> None:
        """Do nothing: the plant exists as soon as the rig does."""

    def arm(self) -> None:
        """Do nothing: it only measures."""

    def make_safe(self) -> None:
        """Do nothing: it only measures."""


def accepted(channel: Channel, value: float) -> float:
    """Return ``value`` clipped to the range of ``channel``, as a drive clips a setpoint.

    Raises:
        DeviceError: ``value`` is not a number.

    """
    if value != value:
        raise DeviceError(
            f"setpoint '{channel.name}' is NaN; expected "
            f"{channel.low:g} to {channel.high:g} {channel.unit}",
            hint="a profile or a limit computed NaN; the previous setpoint holds",
        )
    return min(max(value, channel.low), channel.high)
