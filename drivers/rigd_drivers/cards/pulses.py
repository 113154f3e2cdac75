"""Reads a counter of a card that counts pulses, such as those of a flow meter or a tachometer."""

from __future__ import annotations

from typing import Annotated, ClassVar, Self

from annotated_types import Ge, Gt
from pydantic import StringConstraints, model_validator

from rigd.model.units import parse_quantity, parse_unit
from rigd.sdk import Channel, Declaration, Driver, DriverConfig, In, about_entry, wrong_entry
from rigd_drivers.cards.card import Card
from rigd_drivers.cards.counter import EncoderCounter


class CardPulsesConfig(DriverConfig):
    """Which counter, and what one pulse means."""

    counter: Annotated[int, Ge(0)]
    """Counter of the card."""
    name: Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*$", max_length=40)] = "counted"
    """Name of the channel; the pulses are recorded as NAME_raw."""
    unit: str = "count"
    """SI unit of the channel, such as m^3."""
    scale: str = "1"
    """The quantity per pulse, with its unit over count, such as `0.5 cm^3/count`; 1 if the channel
    is in counts."""
    fastest: Annotated[float, In("count/s"), Gt(0)] = 1e6
    """Rate that the pulses cannot reach. More between two cycles are no pulses: the counter was
    reset."""

    @property
    def per_pulse(self) -> float:
        """:attr:`scale` in SI units."""
        return parse_quantity(self.scale).value

    @model_validator(mode="after")
    def _scale_has_the_unit(self) -> Self:
        unit, scale = parse_unit(self.unit), parse_quantity(self.scale)
        if unit.factor != 1.0:
            raise wrong_entry(
                f"{self.unit} is not an SI unit; give the scale in any unit instead", "unit"
            )
        expected = f"{self.unit}/count"
        if not scale.unit.same_kind(parse_unit(expected)):
            raise wrong_entry(f"scale '{self.scale}' is not in {expected}", "scale")
        if scale.value == 0.0:
            raise wrong_entry(
                "scale must not be 0: every number of pulses would mean the same", "scale"
            )
        return self


class CardPulses(Driver[CardPulsesConfig, Card]):
    """A counter of pulses since the rig was opened; it only measures, and is safe at all times.

    How fast they come is a derived channel: ``derivative(flow.volume)``.
    """

    Config: ClassVar[type[DriverConfig]] = CardPulsesConfig
    title: ClassVar[str] = "pulses on a counter of a card"
    link_kind: ClassVar[str] = "card"

    def __init__(self, config: CardPulsesConfig, link: Card) -> None:
        super().__init__(config, link)
        self._per_pulse = config.per_pulse
        self._counter = EncoderCounter(config.counter, config.fastest)

    @classmethod
    def declare(cls, config: CardPulsesConfig) -> Declaration:
        """Return the quantity and the pulses."""
        channels = (
            Channel(config.name, config.unit, f"counted by counter {config.counter} of the card"),
            Channel(f"{config.name}_raw", "count", "pulses", raw_of=config.name),
        )
        return Declaration(channels=channels, plain_rows=True)

    def open(self) -> None:
        """Count from 0.

        Raises:
            LinkError: the card has no such counter.
        """
        self._counter.open(self.link, at_zero=True)
        self.identity = self.link.identity

    def reserve(self) -> None:
        """See :class:`AnyDriver`: several devices may read one counter."""
        with about_entry("counter"):
            self.link.use_inputs(encoders=(self._counter.encoder,))

    def arm(self) -> None:
        """Do nothing: it only measures."""

    def read(self, t_ns: int) -> tuple[float, float]:
        """Return the quantity, and the pulses since it was opened.

        Raises:
            DeviceError: the counter was reset.
        """
        counts = self._counter.take(self.link)
        return counts * self._per_pulse, float(counts)

    def make_safe(self) -> None:
        """Do nothing: it only measures."""
