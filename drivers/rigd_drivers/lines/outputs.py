"""Defines how a rig file describes setpoints of a device that takes them in lines."""

from __future__ import annotations

import math
from collections.abc import Mapping
from string import Formatter
from typing import Annotated, Self

from annotated_types import Ge, Le, MinLen
from pydantic import field_validator, model_validator

from rigd.sdk import Channel, DriverConfig, In
from rigd_drivers.lines.config import (
    ChannelName,
    Command,
    Commands,
    LineChannel,
    LinesConfig,
)
from rigd_drivers.lines.text import encoded


class LineOutput(LineChannel):
    """One setpoint: its unit in the line, its range, and the line that sets it."""

    low: str
    """Smallest setpoint that the device takes."""
    high: str
    """Largest setpoint that the device takes."""
    write: Command
    r"""Line that sets it, with its name in braces: 'CURR {current:.3f}\n'."""

    def line(self, name: str, value: float) -> bytes:
        """Return the bytes that set ``value``, in SI."""
        number = (value - self.zero) / self.per_one.value
        return encoded(self.write).decode("latin-1").format_map({name: number}).encode("latin-1")


def check_writes(outputs: Mapping[str, LineOutput]) -> None:
    """Check that the line of each setpoint can be filled in with it.

    Raises:
        ValueError: it cannot.
    """
    for name, item in outputs.items():
        names = {found for _, found, _, _ in Formatter().parse(item.write) if found is not None}
        if names != {name}:
            raise ValueError(
                f"'write' of {name} must have {{{name}}} in braces and nothing else: {item.write!r}"
            )
        try:
            item.line(name, item.bound(item.low))
        except (ValueError, KeyError, IndexError) as error:
            raise ValueError(f"{item.write!r} cannot be filled in: {error}") from error


class LineState(DriverConfig):
    """A question whose answer shows whether the device is safe."""

    ask: Command
    r"""Question, such as 'OUTP?\n'."""
    safe: Annotated[str, MinLen(1)]
    """The whole answer if it is safe, such as "0"."""
    ready: Annotated[str, MinLen(1)]
    """The whole answer if its output is on, such as "1"."""

    @model_validator(mode="after")
    def _answers_differ(self) -> Self:
        if self.safe.strip() == self.ready.strip():
            raise ValueError(f"'safe' and 'ready' are the same answer {self.safe!r}")
        return self


class LineOutputsConfig(LinesConfig):
    """A device that is asked, its setpoints, and how it is made safe."""

    ask: Command
    r"""Question for its channels, such as 'MEAS:CURR?\n'."""
    outputs: Annotated[Mapping[ChannelName, LineOutput], MinLen(1)]
    """Setpoints by name."""
    safe: Annotated[Commands, MinLen(1)]
    r"""Lines that make it safe, at once and from any state, such as 'OUTP OFF\n'."""
    state: LineState
    """How it shows that it is safe, and that its output is on."""
    arm: Commands = ()
    r"""Lines that switch its output on, behind those that set all setpoints to rest."""
    timeout: Annotated[float, In("s"), Ge(0.02), Le(0.2)] = 0.1
    """Longest time to an answer; twice that must fit into what making safe may take."""

    @field_validator("outputs")
    @classmethod
    def _writes_have_their_setpoint(
        cls, outputs: Mapping[str, LineOutput]
    ) -> Mapping[str, LineOutput]:
        check_writes(outputs)
        return outputs

    def setpoints(self) -> tuple[Channel, ...]:
        """Return the setpoints in SI."""
        return tuple(item.channel(name) for name, item in self.outputs.items())

    def rest(self) -> tuple[float, ...]:
        """Return zero for each setpoint, or what is nearest to it in its range."""
        return tuple(min(max(0.0, item.low), item.high) for item in self.setpoints())


def clipped(value: float, channel: Channel) -> float:
    """Return ``value`` within the range of ``channel``; NaN stays NaN."""
    return value if math.isnan(value) else min(max(value, channel.low), channel.high)
