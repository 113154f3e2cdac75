"""Defines which keys and values a procedure file may use for setpoint profiles."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Ge, Le
from pydantic import AfterValidator, Field

from rigd.config.source import QuantityText as Expression
from rigd.config.source import Source
from rigd.model.patterns import quantity_schema
from rigd.procedure.profiles.profiles import TAPS

#: Expressions whose unit follows from the key.
Time = Annotated[str, Field(json_schema_extra=quantity_schema("s"))]
Frequency = Annotated[str, Field(json_schema_extra=quantity_schema("Hz"))]
Angle = Annotated[str, Field(json_schema_extra=quantity_schema("rad"))]


def _register_order(value: int) -> int:
    if value not in TAPS:
        orders = ", ".join(map(str, TAPS))
        raise ValueError(f"order {value} is not one of {orders}")
    return value


class ProfileSource(Source):
    """A setpoint over time; exactly one key is given."""

    ramp: RampSource | None = None
    """A straight line from one value to another, then held."""
    sine: SineSource | None = None
    """A sine."""
    square: SquareSource | None = None
    """Two values that alternate."""
    chirp: ChirpSource | None = None
    """A sine of rising or falling frequency."""
    prbs: PrbsSource | None = None
    """A pseudo-random binary sequence of maximum length."""
    table: TableProfileSource | None = None
    """Values at times."""


class RampSource(Source):
    """A straight line from one value to another, then held."""

    start: Annotated[Expression | None, Field(alias="from")] = None
    """First value; by default the present setpoint."""
    to: Expression
    """Last value."""
    over: Time
    """Duration."""


class SineSource(Source):
    """`offset + amplitude sin(2 pi frequency t + phase)`."""

    amplitude: Expression
    """Half of the peak-to-peak value."""
    frequency: Frequency
    """Periods per second."""
    offset: Expression | None = None
    """Value in the middle; by default zero."""
    phase: Angle = "0 deg"
    """Phase at the start."""
    fade: Time | None = None
    """In this time the amplitude falls linearly to zero."""


class SquareSource(Source):
    """`offset + amplitude` and `offset - amplitude` that alternate."""

    amplitude: Expression
    """Half of the peak-to-peak value."""
    frequency: Frequency
    """Periods per second."""
    offset: Expression | None = None
    """Value in the middle; by default zero."""


class ChirpSource(Source):
    """A sine whose frequency changes with continuous phase."""

    amplitude: Expression
    """Half of the peak-to-peak value."""
    start: Annotated[Frequency, Field(alias="from")]
    """First frequency."""
    to: Frequency
    """Last frequency, held afterwards."""
    over: Time
    """Duration."""
    offset: Expression | None = None
    """Value in the middle; by default zero."""
    spacing: Literal["linear", "logarithmic"] = "linear"
    """Whether the frequency grows by a constant amount or factor per second."""


class PrbsSource(Source):
    """`offset + amplitude` or `offset - amplitude`, bit by bit."""

    amplitude: Expression
    """Half of the peak-to-peak value."""
    bit: Time
    """Length of one bit."""
    order: Annotated[
        int, AfterValidator(_register_order), Field(json_schema_extra={"enum": list(TAPS)})
    ] = 9
    """Bits of the shift register; the sequence repeats after `2^order - 1` bits."""
    offset: Expression | None = None
    """Value in the middle; by default zero."""
    seed: Annotated[int, Ge(0), Le(2**31)] = 1
    """The place in the sequence at which it begins."""


class TableProfileSource(Source):
    """Values at times."""

    times: Annotated[list[Time], Field(min_length=1, max_length=10_000)]
    """Times since the start of the step, rising from 0 s."""
    values: Annotated[list[Expression], Field(min_length=1, max_length=10_000)]
    """One value for each time."""
    hold: bool = False
    """Whether each value stays until the next time, instead of a straight line between them."""
