"""Reads an incremental encoder on a counter of a card as an angle or a position."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Final, Literal, Self

from annotated_types import Ge, Gt
from pydantic import model_validator

from rigd.sdk import Channel, Declaration, Driver, DriverConfig, In, Row, about_entry, wrong_entry
from rigd_drivers.cards.card import Card
from rigd_drivers.cards.counter import EncoderCounter
from rigd_drivers.encoder_rows import AngleRow, PositionRow

#: Bit of the status word: the index signal of the encoder is active.
INDEX: Final = 1

#: Options that only one kind of encoder has.
_OPTIONS: Final = {
    "angle": ("counts_per_revolution", "gear_ratio"),
    "position": ("distance_per_count",),
}


class CardEncoderConfig(DriverConfig):
    """Which encoder, and how its counts become an angle or a position."""

    encoder: Annotated[int, Ge(0)]
    """Encoder input of the card."""
    quantity: Literal["angle", "position"]
    """What it measures: a shaft (`angle`, in rad) or a travel (`position`, in m)."""
    counts_per_revolution: Annotated[float, In("count/rad"), Gt(0)] = 1024 / (2 * math.pi)
    """Counts (four per line) per revolution of the encoder's own shaft (angle only)."""
    gear_ratio: Annotated[float, In("1"), Gt(0)] = 1.0
    """Turns of the encoder per turn of what is measured (angle only)."""
    distance_per_count: Annotated[float, In("m/count"), Gt(0)] | None = None
    """Travel per count (position only)."""
    inverted: bool = False
    """Whether the count falls as the quantity grows."""
    zero_at_open: bool = True
    """Whether the quantity is zero at the opening of the rig; otherwise the counter decides."""
    fastest: Annotated[float, In("count/s"), Gt(0)] = 1e6
    """Count rate that the rig cannot reach. More between two cycles is no motion: the counter was
    reset, or lost its signal."""

    @model_validator(mode="after")
    def _options_fit_the_quantity(self) -> Self:
        other = "position" if self.quantity == "angle" else "angle"
        misplaced = self.model_fields_set.intersection(_OPTIONS[other])
        if misplaced:
            raise wrong_entry(
                f"'{min(misplaced)}' belongs to 'quantity: {other}'; remove it here", min(misplaced)
            )
        if self.quantity == "position" and self.distance_per_count is None:
            raise wrong_entry(
                "'quantity: position' needs 'distance_per_count', such as 10 um/count",
                "distance_per_count",
            )
        return self


class CardEncoder(Driver[CardEncoderConfig, Card]):
    """An incremental encoder; it only measures, and is safe at all times."""

    Config: ClassVar[type[DriverConfig]] = CardEncoderConfig
    title: ClassVar[str] = "incremental encoder on a card"
    link_kind: ClassVar[str] = "card"

    def __init__(self, config: CardEncoderConfig, link: Card) -> None:
        super().__init__(config, link)
        self._is_angle = config.quantity == "angle"
        if self._is_angle:
            scale = 1.0 / (config.counts_per_revolution * config.gear_ratio)
        else:
            scale = config.distance_per_count or math.nan
        self._scale = -scale if config.inverted else scale
        self._counter = EncoderCounter(config.encoder, config.fastest)

    @classmethod
    def declare(cls, config: CardEncoderConfig) -> Declaration:
        """Return the angle or the position, and the counts."""
        row: type[Row]
        if config.quantity == "angle":
            row, converted = AngleRow, Channel("angle", "rad", "angle of the shaft")
        else:
            row, converted = PositionRow, Channel("position", "m", "position along the travel")
        counts = Channel("counts", "count", "encoder counts", raw_of=converted.name)
        return Declaration(channels=(converted, counts), row=row)

    def open(self) -> None:
        """Begin to count, from zero or from the present value of the counter."""
        self.reserve()
        self._counter.open(self.link, at_zero=self.config.zero_at_open)
        self.identity = self.link.identity

    def reserve(self) -> None:
        """See :class:`AnyDriver`; an encoder may serve two devices."""
        with about_entry("encoder"):
            self.link.use_inputs(encoders=(self.config.encoder,))

    def arm(self) -> None:
        """Do nothing: it only measures."""

    def read(self, t_ns: int) -> AngleRow | PositionRow:
        """Return the angle in rad or position in m, the counts, and the status (index 1).

        Raises:
            DeviceError: the count jumped further than the rig can move.

        """
        counts = self._counter.take(self.link)
        index = self.link.indexes >> self.config.encoder & INDEX
        value = counts * self._scale
        if self._is_angle:
            return AngleRow.of(angle=value, counts=float(counts), status=index)
        return PositionRow.of(position=value, counts=float(counts), status=index)

    def make_safe(self) -> None:
        """Do nothing: it only measures."""
