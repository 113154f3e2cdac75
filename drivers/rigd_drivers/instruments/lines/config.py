"""Defines how a rig file describes a device that sends lines: port, question, columns, units."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal, Self

from annotated_types import Ge, Le, MinLen
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from rigd.model.units import Quantity, parse_quantity
from rigd.sdk import Channel, DriverConfig, In, wrong_entry
from rigd.sdk.port import MAX_LINE, PortConfig
from rigd_drivers.instruments.lines.text import commands, encoded

#: Column of a line that is not read.
SKIPPED: Final = "-"
#: Time without a readable line after which the device is given up, in s, if it is not given: a
#: device that is asked has so many chances to answer.
_LEAST_SILENCE_S: Final = 3.0
_CHANCES: Final = 3


def _command(text: str) -> str:
    encoded(text)  # raises ValueError
    return text


#: Bytes to send, as text with escapes.
Command = Annotated[str, MinLen(1), AfterValidator(_command)]
Commands = Annotated[tuple[Command, ...], BeforeValidator(commands)]


class LineChannel(DriverConfig):
    """What one number in a line means."""

    unit: str
    """Unit of the number in the line, such as kN, degC or "1"; or what 1 in the line means, such as
    0.01 N or, for tenths of a degree, 0.1 degC.
    """
    doc: str = ""
    """What it is, for the recording."""
    low: str | None = None
    """Smallest possible value; a line with a smaller one is not believed."""
    high: str | None = None
    """Largest possible value; a line with a larger one is not believed."""

    @property
    def per_one(self) -> Quantity:
        """What a difference of 1 in the line means; of degrees Celsius 1 K."""
        text = self.unit
        found = parse_quantity(text if re.match(r"[-+.\d]", text) and text != "1" else f"1 {text}")
        return Quantity(found.value - found.unit.offset, found.unit)

    @property
    def zero(self) -> float:
        """What 0 in the line means, in SI."""
        return self.per_one.unit.offset

    def si(self, number: float) -> float:
        """Return the value in SI of a ``number`` in the line."""
        return number * self.per_one.value + self.zero

    def number(self, value: float) -> float:
        """Return the number in the line for a ``value`` in SI."""
        return (value - self.zero) / self.per_one.value

    def bound(self, text: str) -> float:
        """Return a bound in SI.

        Raises:
            ValueError: it is no quantity of the channel's kind.

        """
        kind = self.per_one.unit
        found = parse_quantity(text)
        if not found.unit.same_kind(kind):
            raise ValueError(f"'{text}' is in {found.unit}, expected {kind}")
        return found.value

    def channel(self, name: str) -> Channel:
        """Return the channel that is recorded."""
        low = -math.inf if self.low is None else self.bound(self.low)
        high = math.inf if self.high is None else self.bound(self.high)
        unit = self.per_one.unit.symbol
        return Channel.read_in(unit, name, self.doc or name.replace("_", " "), low, high)

    @field_validator("unit")
    @classmethod
    def _unit_is_known(cls, unit: str) -> str:
        if not cls.model_construct(unit=unit).per_one.value:
            raise ValueError(f"unit {unit!r}: 1 in the line cannot mean 0")
        return unit

    @field_validator("low", "high")
    @classmethod
    def _bound_has_the_unit(cls, text: str | None, info: ValidationInfo) -> str | None:
        if text is not None and "unit" in info.data:
            item = cls.model_construct(unit=info.data["unit"])
            bound, low = item.bound(text), info.data.get("low")
            if low is not None and item.bound(low) >= bound:
                raise ValueError(f"low {low} is not below high {text}")
        return text


def _short(value: Any) -> Any:
    return {"unit": value} if isinstance(value, str) else value


ChannelName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]


class LinesConfig(PortConfig):
    """The port of the device, what it is asked, and what the numbers of its line mean."""

    channels: Annotated[
        Mapping[ChannelName, Annotated[LineChannel, BeforeValidator(_short)]], MinLen(1)
    ]
    """Channels by name, each with its unit: `{force: N}` or `{force: {unit: N, low: -5 N}}`."""
    pattern: str | None = None
    """Regular expression of the whole line, with a group `(?P<NAME>...)` for each channel."""
    decimal: Literal["point", "comma"] = "point"
    """What stands in front of the decimals."""
    separator: str = ""
    """What stands between columns; empty: blanks."""
    columns: tuple[str, ...] | None = None
    """In place of a pattern: the channels in the order of the columns; "-" for one not read."""
    ask: Command | None = None
    r"""Question, such as '?\r\n'; none for a device that sends by itself."""
    period: Annotated[float, In("s"), Ge(0.01), Le(60)] = 0.1
    """Time from one question to the next."""
    timeout: Annotated[float, In("s"), Ge(0.02), Le(10)] = 0.5
    """Longest time to an answer."""
    silence: Annotated[float, In("s"), Ge(0.1), Le(600)] | None = None
    """Without a readable line for so long the device has failed; by default 3 s, or the time of 3
    questions if that is more.
    """
    beyond: tuple[str, ...] = ()
    """Words that stand in place of a number beyond the device's range, such as OL or -----; the
    value is NaN, which trips an interlock.
    """
    identify: Command | None = None
    r"""Question for its identity, such as '*IDN?\n'; the answer stands in the recording."""
    start: Commands = ()
    """Commands sent when it is opened, in order."""
    stop: Commands = ()
    """Commands sent when it is closed, in order."""
    longest: Annotated[int, Ge(8), Le(4096)] = MAX_LINE
    """Longest line in bytes; a longer one is thrown away."""

    @property
    def silence_s(self) -> float:
        """Longest time without a readable line, in s."""
        if self.silence is not None:
            return self.silence
        if self.ask is None:
            return _LEAST_SILENCE_S
        return max(_LEAST_SILENCE_S, _CHANCES * (self.period + self.timeout))

    @field_validator("pattern")
    @classmethod
    def _pattern_has_the_channels(cls, pattern: str | None, info: ValidationInfo) -> str | None:
        if pattern is None:
            return None
        try:
            groups = list(re.compile(pattern, re.ASCII).groupindex)
        except re.error as error:
            raise ValueError(f"{pattern!r} is no regular expression: {error}") from error
        _check_names("the pattern", "group", groups, info)
        return pattern

    @field_validator("columns")
    @classmethod
    def _columns_are_the_channels(
        cls, columns: tuple[str, ...] | None, info: ValidationInfo
    ) -> tuple[str, ...] | None:
        if columns is None:
            return None
        named = [name for name in columns if name != SKIPPED]
        if twice := {name for name in named if named.count(name) > 1}:
            raise ValueError(f"column {min(twice)!r} stands here twice")
        _check_names("the list", "column", named, info)
        if info.data.get("decimal") == "comma" and info.data.get("separator") == ",":
            raise ValueError("a comma cannot be both `separator` and `decimal`")
        return columns

    @model_validator(mode="after")
    def _described_once(self) -> Self:
        if (self.pattern is None) == (self.columns is None):
            raise wrong_entry(
                "a line is described by either 'pattern' or 'columns': give one", "columns"
            )
        return self


def _check_names(where: str, what: str, found: list[str], info: ValidationInfo) -> None:
    channels = info.data.get("channels")
    if channels is None:  # wrong itself, and reported
        return
    if unknown := [name for name in found if name not in channels]:
        raise ValueError(f"{what} {unknown[0]!r} has no entry in `channels`")
    if absent := [name for name in channels if name not in found]:
        raise ValueError(f"{where} has no {what} {absent[0]!r}, which `channels` has")
