"""Reads the analogue inputs of a card, each with its own name, unit, scale and zero."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Self

from annotated_types import Ge, MinLen
from pydantic import StringConstraints, field_validator, model_validator

from rigd.model.units import correct_scale, parse_quantity, parse_unit
from rigd.sdk import (
    Channel,
    Declaration,
    Documented,
    Driver,
    DriverConfig,
    In,
    about_entry,
    wrong_entry,
)
from rigd_drivers.cards.card import Card


class AnalogInput(Documented):
    """One analogue input and what its volts mean."""

    name: Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*$", max_length=40)]
    """Name of the channel; the volts are recorded as NAME_raw."""
    input: Annotated[int, Ge(0)]
    """Analogue input of the card."""
    unit: str
    """Unit in which people read the channel, such as `m/s^2`, `kN` or `degC`; recorded in SI."""
    scale: str
    """Change of the quantity per volt, with its unit, such as `9.8 m/s^2/V`; may be negative."""
    zero: Annotated[float, In("V")] = 0.0
    """Voltage at which the quantity is zero in its unit."""
    doc: str | None = None
    """What it measures, for the recording."""

    @model_validator(mode="after")
    def _scale_fits(self) -> Self:
        wanted = f"{parse_unit(self.unit).difference()}/V"
        given = parse_quantity(self.scale)
        if not given.unit.same_kind(parse_unit(wanted)):
            raise wrong_entry(
                f"scale '{self.scale}' of {self.name} is not in {wanted}: "
                f"{correct_scale(given, wanted)}",
                "scale",
            )
        if given.value == 0.0:
            raise wrong_entry(f"scale '{self.scale}' of {self.name} must not be 0", "scale")
        return self

    @property
    def per_volt(self) -> float:
        """The scale in SI, per volt."""
        return parse_quantity(self.scale).value

    @property
    def origin(self) -> float:
        """What ``zero`` volts mean, in SI: not 0 for a unit with a zero of its own."""
        return parse_unit(self.unit).offset

    def channels(self) -> tuple[Channel, Channel]:
        """Return the converted channel and the raw one."""
        source = f"analogue input {self.input} of the card"
        ends = [(volts - self.zero) * self.per_volt + self.origin for volts in (-10.0, 10.0)]
        low, high = min(ends), max(ends)
        if self.origin:  # no temperature is below 0 K
            low = max(low, 0.0)
        return (
            Channel.read_in(self.unit, self.name, self.doc or f"by {source}", low, high),
            Channel(f"{self.name}_raw", "V", source, -10, 10, raw_of=self.name),
        )


class CardAnalogConfig(DriverConfig):
    """The inputs, in the order they are recorded."""

    inputs: Annotated[tuple[AnalogInput, ...], MinLen(1)]
    """The analogue inputs."""

    @field_validator("inputs")
    @classmethod
    def _names_differ(cls, inputs: tuple[AnalogInput, ...]) -> tuple[AnalogInput, ...]:
        names = [channel.name for item in inputs for channel in item.channels()]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"two channels are called '{name}'")
        return inputs


class CardAnalog(Driver[CardAnalogConfig, Card]):
    """Analogue sensors on a card; they only measure, and are safe at all times."""

    Config: ClassVar[type[DriverConfig]] = CardAnalogConfig
    title: ClassVar[str] = "analogue sensors on a card"
    link_kind: ClassVar[str] = "card"

    def __init__(self, config: CardAnalogConfig, link: Card) -> None:
        super().__init__(config, link)
        self._inputs = tuple(
            (item.input, item.per_volt, item.zero, item.origin) for item in config.inputs
        )

    @classmethod
    def declare(cls, config: CardAnalogConfig) -> Declaration:
        """Return the channels of every input."""
        channels = tuple(channel for item in config.inputs for channel in item.channels())
        return Declaration(channels=channels, plain_rows=True, has_status=True)

    def open(self) -> None:
        """Take the inputs in from now on."""
        self.reserve()
        self.identity = self.link.identity

    def reserve(self) -> None:
        """See :class:`AnyDriver`: the inputs are this device's alone."""
        for place, item in enumerate(self.config.inputs):
            with about_entry("inputs", place, "input"):
                self.link.use_inputs(analog=(item.input,))

    def arm(self) -> None:
        """Do nothing: it only measures."""

    def read(self, t_ns: int) -> Sequence[float]:
        """Return value and volts of every input, and the status: bit i, input i at a rail."""
        card = self.link
        row: list[float] = []
        status = 0
        for index, (channel, per_volt, zero, origin) in enumerate(self._inputs):
            volts = card.volts[channel]
            if volts <= card.lowest_volts or volts >= card.highest_volts:
                status |= 1 << index
            row += ((volts - zero) * per_volt + origin, volts)
        row.append(status)
        return row

    def make_safe(self) -> None:
        """Do nothing: it only measures."""
