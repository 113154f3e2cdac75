"""Checks a setpoint before it becomes an input of the physics."""

from __future__ import annotations

from rigd.sdk import Channel, DeviceError


def accepted(channel: Channel, value: float) -> float:
    """Return ``value`` clipped to the range of ``channel``, as a drive clips what it is sent.

    Raises:
        DeviceError: ``value`` is not a number.

    """
    if value != value:
        raise DeviceError(
            f"setpoint '{channel.name}' is NaN; expected "
            f"{channel.low:g} to {channel.high:g} {channel.unit}",
            hint="a profile or a limit made a number of nothing; the setpoint before it holds",
        )
    return min(max(value, channel.low), channel.high)
