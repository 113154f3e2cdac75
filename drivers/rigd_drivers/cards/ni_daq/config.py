"""Defines the options of an NI card and of its analogue inputs."""

from __future__ import annotations

from enum import Enum
from typing import Annotated, Final, Self

from annotated_types import Ge, Gt, Le, Len
from pydantic import Field, model_validator

from rigd.model.channels import Channel
from rigd.model.units import correct_scale, format_quantity, parse_quantity, parse_unit
from rigd.sdk import DriverConfig, In, wrong_entry
from rigd_drivers.cards.ni_card import NiCardConfig

#: The status word has a bit for each input, and bit 31 is not the driver's.
MOST_INPUTS: Final = 31


class Terminal(Enum):
    """How an input is wired; the names and numbers are NI-DAQmx's (Terminal Configuration)."""

    DEFAULT = "default"
    RSE = "rse"
    NRSE = "nrse"
    DIFFERENTIAL = "differential"
    PSEUDO_DIFFERENTIAL = "pseudo-differential"


class Input(DriverConfig):
    """One analogue input and what its volts mean: ``(volts - zero) * scale``.

    With a ``unit`` that has a zero of its own (degC), that is how far the value is above that zero.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    """Name of the channel, such as acceleration; its volts are recorded beside it as NAME_raw."""
    channel: Annotated[str, Field(pattern=r"^[A-Za-z0-9_]+$")]
    """Physical channel of the card, without the card's name, such as ai0."""
    terminal: Terminal = Terminal.DEFAULT
    """How it is wired: default, rse, nrse, differential or pseudo-differential."""
    range: Annotated[float, In("V"), Gt(0)] = 10.0
    """Largest voltage to be measured, either sign; the card takes its next larger range."""
    unit: str = "V"
    """Unit in which people read the channel, such as m/s^2, kN or degC; it is recorded in SI."""
    scale: str = "1 V/V"
    """The quantity per volt, such as 9.8 m/s^2/V; negative if the sensor is mounted reversed."""
    zero: Annotated[float, In("V")] = 0.0
    """Voltage that means 0 in the unit."""
    low: str | None = None
    """Least that the sensor can measure, such as -50 degC; by default what `range` means."""
    high: str | None = None
    """Most that the sensor can measure."""

    @property
    def origin(self) -> float:
        """What ``zero`` volts mean, in SI: not 0 for a unit with a zero of its own."""
        return parse_unit(self.unit).offset

    @property
    def gain(self) -> float:
        """:attr:`scale` in SI units per volt."""
        return parse_quantity(self.scale).value

    @property
    def channels(self) -> tuple[Channel, Channel]:
        """The channel in its unit and the one in volts that it is made from."""
        low, high = self._ends()
        raw = f"{self.name}_raw"
        return (
            Channel.read_in(self.unit, self.name, f"input {self.channel}", low, high),
            Channel(raw, "V", f"at {self.channel}", -self.range, self.range, raw_of=self.name),
        )

    def _ends(self) -> tuple[float, float]:
        """Return what the channel can measure, in SI: no temperature is below 0 K."""
        low, high = sorted(
            (side * self.range - self.zero) * self.gain + self.origin for side in (-1, 1)
        )
        if self.origin:
            low = max(low, 0.0)
        low = low if self.low is None else max(low, In(self.unit).read(self.low))
        high = high if self.high is None else min(high, In(self.unit).read(self.high))
        return low, high

    @model_validator(mode="after")
    def _scale_has_the_unit(self) -> Self:
        unit, scale = parse_unit(self.unit), parse_quantity(self.scale)
        expected = f"{unit.difference()}/V"
        if not scale.unit.same_kind(parse_unit(expected)):
            raise wrong_entry(
                f"scale '{scale}' of input {self.name} is in {scale.unit}, expected {expected}: "
                f"{correct_scale(scale, expected)}",
                "scale",
            )
        if scale.value == 0.0:
            raise wrong_entry(
                f"scale of input {self.name} is 0: every voltage would mean the same", "scale"
            )
        low, high = self._ends()
        if low >= high:
            shown = " to ".join(format_quantity(end, self.unit) for end in (low, high))
            key = next((key for key in ("low", "high") if key in self.model_fields_set), "range")
            raise wrong_entry(f"input {self.name} can measure nothing: {shown}", key)
        return self


class NiDaqConfig(NiCardConfig):
    """Which card, which of its inputs, and how fast."""

    inputs: Annotated[tuple[Input, ...], Len(1, MOST_INPUTS)]
    """The analogue inputs, in the order in which the card converts them."""
    rate: Annotated[float, In("Hz"), Gt(0)] = 9600.0
    """Samples per second of each input."""
    block: Annotated[int, Ge(1), Le(100_000)] = 96
    """Samples of each input that are fetched together."""
    median: Annotated[int, Ge(1), Le(1000)] = 1
    """Interlocks and end conditions see the median of so many of a block's last samples, so that
    a single noisy one stops nothing; 1 is the last sample. All are recorded as they are."""
    buffer: Annotated[float, In("s"), Ge(0.1), Le(60)] = 5.0
    """How long NI-DAQmx keeps samples that have not been fetched."""

    @property
    def buffer_samples(self) -> int:
        """Samples per input that the buffer holds: whole blocks, two at least."""
        blocks = -(-self.buffer * self.rate // self.block)  # rounded up
        return max(2, int(blocks)) * self.block

    @model_validator(mode="after")
    def _median_within_a_block(self) -> Self:
        if self.median > self.block:
            raise wrong_entry(
                f"a median of {self.median} samples needs more than a block of {self.block}: "
                "give a shorter median or a longer block",
                "median",
            )
        return self

    @model_validator(mode="after")
    def _inputs_are_distinct(self) -> Self:
        for key in ("name", "channel"):
            given = [getattr(item, key) for item in self.inputs]
            twice = next((item for item in given if given.count(item) > 1), None)
            if twice is not None:
                raise wrong_entry(
                    f"two inputs have the {key} {twice!r}; give each its own",
                    "inputs",
                    len(given) - 1 - given[::-1].index(twice),
                    key,
                )
        names = {item.name for item in self.inputs}
        raws = {f"{name}_raw" for name in names}
        taken = names & (raws | {"device_time", "clock_rate", "status", "t_ns"})
        if taken:
            raise wrong_entry(
                f"an input cannot be named {min(taken)!r}: rigd records that itself",
                "inputs",
                [item.name for item in self.inputs].index(min(taken)),
                "name",
            )
        return self
