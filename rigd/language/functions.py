"""Defines the functions: what each takes, which units fit, and which operation it is."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Literal

from rigd.language.dimensions import alike, over, times
from rigd.language.number import ExpressionError, Number
from rigd.language.operations import Op
from rigd.language.rows import Rows, operate, over_time
from rigd.model.units import NO_DIMENSION, Dimension, dimension_text, parse_unit, si_symbol

#: Most samples of a window or a delay: 10 s at 1 kHz.
MAX_SAMPLES: Final = 10_000
#: Most points of a table.
MAX_POINTS: Final = 200

_SECOND: Final = parse_unit("s").dimension
_HERTZ: Final = parse_unit("Hz").dimension
_ANGLE: Final = parse_unit("rad").dimension

Kind = Literal["quantity", "condition", "constant", "list"]


@dataclass(frozen=True, eq=False)
class Call:
    """A use of a function: where its rows go, and where its values stand in the text."""

    rows: Rows | None
    places: Sequence[int]
    usage: str
    tables: Sequence[Sequence[Number]] = ()

    def wrong(self, message: str, argument: int = 0) -> ExpressionError:
        """Return the error that ``argument`` is wrong."""
        return ExpressionError(message, self.places[argument], self.usage)

    def add(
        self,
        op: Op,
        *numbers: Number,
        dimension: Dimension = NO_DIMENSION,
        parameters: tuple[float, ...] = (),
        size: int = 0,
    ) -> Number:
        """Return the result of an operation."""
        return operate(
            self.rows, op, *numbers, at=self.places[0], dimension=dimension,
            parameters=parameters, size=size,
        )  # fmt: skip

    @property
    def period_s(self) -> float:
        """The shortest time between two values.

        Raises:
            ExpressionError: there is one value only.
        """
        if self.rows is None:
            raise over_time(self.places[0])
        return self.rows.period_s

    def of_kind(self, number: Number, dimension: Dimension, argument: int) -> float:
        """Return the value of a fixed quantity of ``dimension``.

        Raises:
            ExpressionError: it has another dimension, a unit with a zero of its own, or is not
                above 0.
        """
        if number.unit:
            raise ExpressionError(
                f"expected a difference, found a value in {number.unit}", self.places[argument],
                f"write it in {parse_unit(number.unit).difference()}",
            )  # fmt: skip
        if number.dimension != dimension:
            raise self.wrong(
                f"expected {si_symbol(dimension)}, found {dimension_text(number.dimension)}",
                argument,
            )
        if not number.value > 0:
            raise self.wrong("expected a value above 0", argument)
        return number.value


@dataclass(frozen=True)
class Function:
    """A function: ``usage`` for people, what it ``takes``, and how its rows are made."""

    usage: str
    takes: tuple[Kind, ...]
    make: Callable[[Call, Sequence[Number]], Number]


def _same(call: Call, first: Number, second: Number) -> Dimension:
    if not alike(first.dimension, second.dimension):
        raise call.wrong(
            f"expected {dimension_text(first.dimension)}, found {dimension_text(second.dimension)}",
            len(call.places) - 1,
        )
    return first.dimension


def _abs(call: Call, terms: Sequence[Number]) -> Number:
    return call.add(Op.ABS, *terms, dimension=terms[0].dimension)


def _sqrt(call: Call, terms: Sequence[Number]) -> Number:
    dimension = terms[0].dimension
    if any(power % 2 for power in dimension):
        raise call.wrong(f"{dimension_text(dimension)} has no root with a unit")
    half = tuple(power // 2 for power in dimension)
    return call.add(Op.SQRT, *terms, dimension=half)


def _of_angle(op: Op) -> Callable[[Call, Sequence[Number]], Number]:
    def make(call: Call, terms: Sequence[Number]) -> Number:
        if terms[0].dimension != _ANGLE:
            raise call.wrong(
                f"expected an angle in rad, found {dimension_text(terms[0].dimension)}"
            )
        return call.add(op, *terms)

    return make


def _atan2(call: Call, terms: Sequence[Number]) -> Number:
    _same(call, *terms)
    return call.add(Op.ATAN2, *terms, dimension=_ANGLE)


def _pair(op: Op) -> Callable[[Call, Sequence[Number]], Number]:
    def make(call: Call, terms: Sequence[Number]) -> Number:
        return call.add(op, *terms, dimension=_same(call, *terms))

    return make


def _where(call: Call, terms: Sequence[Number]) -> Number:
    dimension = _same(call, terms[1], terms[2])
    return call.add(Op.WHERE, *terms, dimension=dimension)


def _hold(call: Call, terms: Sequence[Number]) -> Number:
    return call.add(Op.HOLD, *terms, dimension=terms[0].dimension)


def _deadband(call: Call, terms: Sequence[Number]) -> Number:
    band = call.of_kind(terms[1], terms[0].dimension, 1)
    return call.add(Op.DEADBAND, terms[0], dimension=terms[0].dimension, parameters=(band,))


def _lookup(call: Call, terms: Sequence[Number]) -> Number:
    inputs, outputs = call.tables
    if len(inputs) != len(outputs) or not 2 <= len(inputs) <= MAX_POINTS:
        raise call.wrong(
            f"expected two lists of the same length, 2 to {MAX_POINTS}, found {len(inputs)} "
            f"and {len(outputs)}",
            1,
        )
    for point in inputs:
        if point.dimension != terms[0].dimension:
            raise call.wrong(
                f"expected {dimension_text(terms[0].dimension)}, found "
                f"{dimension_text(point.dimension)}",
                1,
            )
    if any(point.dimension != outputs[0].dimension for point in outputs):
        raise call.wrong("the values of the table have different units", 2)
    xs = tuple(point.value for point in inputs)
    if any(later <= earlier for earlier, later in pairwise(xs)):
        raise call.wrong("the points of the table do not increase", 1)
    ys = tuple(point.value for point in outputs)
    return call.add(
        Op.LOOKUP, terms[0], dimension=outputs[0].dimension, parameters=xs + ys, size=len(xs)
    )


def _derivative(call: Call, terms: Sequence[Number]) -> Number:
    return call.add(Op.DERIVATIVE, *terms, dimension=over(terms[0].dimension, _SECOND))


def _lowpass(call: Call, terms: Sequence[Number]) -> Number:
    frequency = call.of_kind(terms[1], _HERTZ, 1)
    most = 0.25 / call.period_s
    if frequency > most:
        raise call.wrong(
            f"a filter of {frequency:g} Hz is too fast for a cycle of {1 / call.period_s:g} Hz: "
            f"at most {most:g} Hz",
            1,
        )
    return call.add(
        Op.LOWPASS, terms[0], dimension=terms[0].dimension, parameters=(2 * math.pi * frequency,)
    )


def _integral(call: Call, terms: Sequence[Number]) -> Number:
    dimension = times(terms[0].dimension, _SECOND)
    return call.add(Op.INTEGRAL, *terms, dimension=dimension)


def _window(op: Op) -> Callable[[Call, Sequence[Number]], Number]:
    def make(call: Call, terms: Sequence[Number]) -> Number:
        window_s = call.of_kind(terms[1], _SECOND, 1)
        samples = math.ceil(window_s / call.period_s) + 1
        if samples > MAX_SAMPLES:
            raise call.wrong(
                f"{window_s:g} s is too long for a cycle of {1 / call.period_s:g} Hz: at most "
                f"{(MAX_SAMPLES - 1) * call.period_s:g} s",
                1,
            )
        if window_s < call.period_s:
            raise call.wrong(f"{window_s:g} s is shorter than a cycle", 1)
        return call.add(
            op, terms[0], dimension=terms[0].dimension, parameters=(window_s,), size=samples
        )

    return make


def _rate_limit(call: Call, terms: Sequence[Number]) -> Number:
    rate = over(terms[0].dimension, _SECOND)
    return call.add(
        Op.RATE_LIMIT,
        terms[0],
        dimension=terms[0].dimension,
        parameters=(call.of_kind(terms[1], rate, 1),),
    )


def _edges(call: Call, terms: Sequence[Number]) -> Number:
    return call.add(Op.EDGES, *terms)


#: The functions by name.
FUNCTIONS: Final[dict[str, Function]] = {
    "abs": Function("abs(x)", ("quantity",), _abs),
    "sqrt": Function("sqrt(x)", ("quantity",), _sqrt),
    "sin": Function("sin(angle)", ("quantity",), _of_angle(Op.SIN)),
    "cos": Function("cos(angle)", ("quantity",), _of_angle(Op.COS)),
    "tan": Function("tan(angle)", ("quantity",), _of_angle(Op.TAN)),
    "atan2": Function("atan2(y, x)", ("quantity", "quantity"), _atan2),
    "min": Function("min(x, y)", ("quantity", "quantity"), _pair(Op.MIN)),
    "max": Function("max(x, y)", ("quantity", "quantity"), _pair(Op.MAX)),
    "where": Function(
        "where(condition, x, y): x while the condition holds, else y",
        ("condition", "quantity", "quantity"),
        _where,
    ),
    "hold": Function(
        "hold(x, condition): x while the condition holds, else its last value",
        ("quantity", "condition"),
        _hold,
    ),
    "deadband": Function("deadband(x, 0.1 N)", ("quantity", "constant"), _deadband),
    "lookup": Function(
        "lookup(x, [0 V, 5 V], [0 N, 100 N])", ("quantity", "list", "list"), _lookup
    ),
    "derivative": Function("derivative(x)", ("quantity",), _derivative),
    "lowpass": Function("lowpass(x, 50 Hz)", ("quantity", "constant"), _lowpass),
    "integral": Function("integral(x)", ("quantity",), _integral),
    "mean": Function("mean(x, 0.5 s)", ("quantity", "constant"), _window(Op.MEAN)),
    "rms": Function("rms(x, 0.5 s)", ("quantity", "constant"), _window(Op.RMS)),
    "highest": Function("highest(x, 0.5 s)", ("quantity", "constant"), _window(Op.HIGHEST)),
    "lowest": Function("lowest(x, 0.5 s)", ("quantity", "constant"), _window(Op.LOWEST)),
    "ratelimit": Function("ratelimit(x, 5 N/s)", ("quantity", "constant"), _rate_limit),
    "delay": Function("delay(x, 20 ms)", ("quantity", "constant"), _window(Op.DELAY)),
    "edges": Function("edges(condition): how often it became true", ("condition",), _edges),
}


def reachable(name: str) -> str:
    """Return a hint for the unknown function ``name``."""
    near = difflib.get_close_matches(name, FUNCTIONS, n=1, cutoff=0.6)
    return f"did you mean {near[0]!r}?" if near else "known: " + ", ".join(FUNCTIONS)
