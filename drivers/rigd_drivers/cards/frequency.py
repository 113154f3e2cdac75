"""Reads the frequency of pulses at a counter of a card, and how long they are high.

Such pulses come from flow meters, from tachometers, and from sensors that give a pulse width.
"""

from __future__ import annotations

import math
import time
from typing import Annotated, ClassVar, Final, Self

from annotated_types import Ge, Le
from pydantic import StringConstraints, model_validator

from rigd.model.units import parse_quantity, parse_unit
from rigd.sdk import Channel, Declaration, Driver, DriverConfig, In, about_entry, wrong_entry
from rigd_drivers.cards.card import Card, Train

#: Status: no pulse has come within the longest period, or only the first one since then.
STANDING: Final = 1
_LOOK_S: Final = 0.005


class CardFrequencyConfig(DriverConfig):
    """Which counter, what one pulse means, and when no pulse means standing."""

    counter: Annotated[int, Ge(0)]
    """Counter of the card."""
    name: Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*$", max_length=40)] = (
        "frequency"
    )
    """Name of the channel; the frequency of the pulses is recorded as NAME_raw, in Hz."""
    unit: str = "Hz"
    """Unit in which people read the channel, such as rpm or L/min; recorded in SI."""
    scale: str | None = None
    """The quantity per pulse, with its unit over count, such as `0.5 cm^3/count` or
    `1 rev/count`; leave it out for a channel in Hz."""
    slowest: Annotated[float, In("Hz"), Ge(0.05), Le(1000)] = 1.0
    """Lowest frequency to be measured. Once no pulse has come for its period, such as 1 s at 1 Hz,
    the channel is 0."""
    width: bool = False
    """Whether the width of the pulses is measured, too: NAME_width in s, and NAME_duty, the part
    of the period for which the signal is high. Both are NaN while no pulses come."""

    @property
    def per_pulse(self) -> float:
        """:attr:`scale` in SI units."""
        return 1.0 if self.scale is None else parse_quantity(self.scale).value

    @model_validator(mode="after")
    def _scale_has_the_unit(self) -> Self:
        wanted = f"{self.unit} s/count"
        if self.scale is None:
            if not parse_unit(self.unit).same_kind(parse_unit("Hz")):
                raise wrong_entry(
                    f"a channel in {self.unit} needs `scale`: the quantity per pulse, in {wanted}",
                    "unit",
                )
            return self
        scale = parse_quantity(self.scale)
        if not scale.unit.same_kind(parse_unit(wanted)):
            raise wrong_entry(f"scale '{self.scale}' is not in {wanted}", "scale")
        if scale.value == 0.0:
            raise wrong_entry("scale must not be 0: every frequency would mean the same", "scale")
        return self


class CardFrequency(Driver[CardFrequencyConfig, Card]):
    """The frequency of pulses; it only measures, and is safe at all times.

    It is the mean over the pulses that have ended since the cycle before. While none ends it falls,
    as the period that runs is at least as long as the time since the last pulse; it is 0 after the
    period of ``slowest``. Then the first pulse begins a period, and the second one ends it.
    """

    Config: ClassVar[type[DriverConfig]] = CardFrequencyConfig
    title: ClassVar[str] = "frequency or width of pulses at a counter of a card"
    link_kind: ClassVar[str] = "card"

    def __init__(self, config: CardFrequencyConfig, link: Card) -> None:
        super().__init__(config, link)
        self._per_pulse = config.per_pulse
        self._longest_s = 1.0 / config.slowest
        self._forget()

    def _forget(self) -> None:
        self._last = Train()
        self._stand()

    def _stand(self) -> None:
        """Know nothing of the pulses; the next one begins a period."""
        self._begun = False
        self._frequency = 0.0
        self._width_s = self._duty = math.nan
        self._still_ns: int | None = None  #: since when no pulse has ended, at the latest

    @classmethod
    def declare(cls, config: CardFrequencyConfig) -> Declaration:
        """Return the quantity, the frequency, and the width."""
        name, source = config.name, f"pulses at counter {config.counter} of the card"
        channels = [
            Channel.read_in(config.unit, name, f"by {source}"),
            Channel(f"{name}_raw", "Hz", f"frequency of {source}", raw_of=name),
        ]
        if config.width:
            channels += [
                Channel(f"{name}_width", "s", f"how long the {source} are high", low=0.0),
                Channel(f"{name}_duty", "1", f"part for which the {source} are high", 0.0, 1.0),
            ]
        return Declaration(
            channels=tuple(channels),
            plain_rows=True,
            has_status=True,
            status_bits={"standing": STANDING},
        )

    def open(self) -> None:
        """Time pulses from now on; for a width, wait for the first for two periods of ``slowest``.

        Raises:
            LinkError: the card has no such counter, or times no pulses.
        """
        self.reserve()  # if it is refused, as of an open one, all stays as it is
        self._forget()
        self.identity = self.link.identity
        until = time.monotonic() + 2 * self._longest_s
        while self.config.width and not self._frequency and time.monotonic() < until:
            self.link.sample()
            self._take()
            time.sleep(_LOOK_S)

    def reserve(self) -> None:
        """See :class:`AnyDriver`: the counter is this device's alone."""
        with about_entry("counter"):
            self.link.use_pulses(
                self.config.counter, longest_s=self._longest_s, width=self.config.width
            )

    def arm(self) -> None:
        """Do nothing: it only measures."""

    def read(self, t_ns: int) -> list[float]:
        """Return the quantity, the frequency, width and duty if wanted, and the status."""
        frequency = self._take()
        row = [frequency * self._per_pulse, frequency]
        if self.config.width:
            row += [self._width_s, self._duty]
        row.append(0 if frequency else STANDING)
        return row

    def _take(self) -> float:
        """Take the pulses that have ended, and return the frequency in Hz."""
        train, last = self.link.trains[self.config.counter], self._last
        self._last = train
        ended = train.pulses - last.pulses
        if ended:
            period_s = (train.periods_s - last.periods_s) / ended
            if self._begun and period_s > 0.0:
                self._frequency = 1.0 / period_s
                self._width_s = (train.high_s - last.high_s) / ended
                self._duty = self._width_s / period_s
            self._begun = True
            self._still_ns = None
            return self._frequency
        # The last pulse may have come while the sample before was taken, but not after this one.
        if self._still_ns is None:
            self._still_ns = self.link.sampled_ns
        still_s = (self.link.sampled_ns - self._still_ns) * 1e-9
        if still_s > self._longest_s:
            self._stand()
        return self._frequency if still_s <= 0.0 else min(self._frequency, 1.0 / still_s)

    def make_safe(self) -> None:
        """Do nothing: it only measures."""
