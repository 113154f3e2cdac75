"""Defines how a rig file describes setpoints of a device that takes them in lines."""

from __future__ import annotations

import math
from collections.abc import Mapping
from string import Formatter
from typing import TYPE_CHECKING, Annotated, Final, Self

from annotated_types import Ge, Le, MinLen
from pydantic import field_validator, model_validator

from rigd.model.units import parse_quantity
from rigd.sdk import Channel, DriverConfig, In, wrong_entry
from rigd_drivers.instruments.lines.config import (
    ChannelName,
    Command,
    Commands,
    LineChannel,
    LinesConfig,
)
from rigd_drivers.instruments.lines.text import encoded

#: Without `within` a setpoint that is read back may differ by this part of its range.
_WITHIN_SHARE: Final = 1e-3


class BoundedOutput(LineChannel):
    """One setpoint: its unit in the line, and its range."""

    low: str
    """Smallest setpoint that the device takes."""
    high: str
    """Largest setpoint that the device takes."""


class ReadBack(BoundedOutput):
    """A setpoint that may be read back from the device, by its `read`."""

    if TYPE_CHECKING:
        read: str | None

    within: str | None = None
    """How far that answer may be from the setpoint; by default 0.1 % of its range."""

    def apart(self, asked: float, read: float) -> bool:
        """Return whether the setpoint that was read back is not the one that was sent, in SI."""
        return not abs(asked - read) <= self.tolerance

    @property
    def tolerance(self) -> float:
        """How far an answer to `read` may be from the setpoint, in SI.

        Raises:
            ValueError: `within` is no difference of values of the setpoint.

        """
        if self.within is None:
            return (self.bound(self.high) - self.bound(self.low)) * _WITHIN_SHARE
        found, kind = parse_quantity(self.within).as_difference(), self.per_one.unit.difference()
        if not found.unit.same_kind(kind):
            raise ValueError(f"'{self.within}' is in {found.unit}, expected {kind}")
        return found.value


class LineOutput(BoundedOutput):
    """One setpoint: its unit in the line, its range, and the line that sets it."""

    write: Command
    r"""Line that sets it, with its name in braces: 'CURR {current:.3f}\n'."""

    def line(self, name: str, value: float) -> bytes:
        """Return the bytes that set ``value``, in SI."""
        text = encoded(self.write).decode("latin-1")
        return text.format_map({name: self.number(value)}).encode("latin-1")


def check_writes(outputs: Mapping[str, LineOutput]) -> None:
    """Check that the line of each setpoint can be filled in with it.

    Raises:
        WrongEntries: it cannot.
    """
    for name, item in outputs.items():
        names = {found for _, found, _, _ in Formatter().parse(item.write) if found is not None}
        if names != {name}:
            raise wrong_entry(
                f"'write' of {name} must have {{{name}}} in braces and nothing else: "
                f"{item.write!r}",
                name,
                "write",
            )
        try:
            item.line(name, item.bound(item.low))
        except (ValueError, KeyError, IndexError) as error:
            raise wrong_entry(
                f"{item.write!r} cannot be filled in: {error}", name, "write"
            ) from error


def check_read_back(setpoints: Mapping[str, ReadBack]) -> None:
    """Check how far the answers may be from the setpoints.

    Raises:
        WrongEntries: `within` of one is no difference of its kind, or not above 0.
    """
    for name, item in setpoints.items():
        try:
            tolerance = item.tolerance
        except ValueError as error:
            raise wrong_entry(str(error), name, "within") from error
        if not tolerance > 0:
            raise wrong_entry(f"within {item.within} of {name} must be above 0", name, "within")


def check_safe_options(setpoints: Mapping[str, object], options: Mapping[str, object]) -> None:
    """Check that an instrument with setpoints states how it is made safe, and one without does not.

    Args:
        setpoints: those of the instrument, by name.
        options: its options `arm`, `safe` and `state`, by name.

    Raises:
        WrongEntries: `safe` or `state` is missing; or there are no setpoints, and one is given.
    """
    if not setpoints:
        given = [key for key, value in options.items() if value]
        if given:
            raise wrong_entry(
                f"'{given[0]}' is for an instrument with setpoints: give some", given[0]
            )
        return
    for key in ("safe", "state"):
        if not options[key]:
            raise wrong_entry(
                f"with setpoints, '{key}' is needed: how the instrument is made safe, and how it "
                "shows that",
                "setpoints",
            )


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
            raise wrong_entry(f"'safe' and 'ready' are the same answer {self.safe!r}", "ready")
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
