"""Defines the functions of formulas: what each takes, which units fit, and the rows it adds."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Literal, NamedTuple

from rigd.computed.derived.dimensions import alike, over, times
from rigd.computed.derived.graph import Builder, Op, Term
from rigd.computed.derived.quantities import FormulaError
from rigd.model.units import Dimension, dimension_text, parse_unit, si_symbol

#: Most samples of a window or a delay: 10 s at 1 kHz.
MAX_SAMPLES: Final = 10_000
#: Most points of a table.
MAX_POINTS: Final = 200

_SECOND: Final = parse_unit("s").dimension
_HERTZ: Final = parse_unit("Hz").dimension
_ANGLE: Final = parse_unit("rad").dimension

Kind = Literal["quantity", "condition", "constant", "list"]


class Fixed(NamedTuple):
    """A fixed quantity in a list; ``unit`` as in :class:`Term`."""

    value: float
    dimension: Dimension
    unit: str = ""


@dataclass(frozen=True)
class Call:
    """A use of a function: where its rows go, and where it stands in the formula."""

    builder: Builder
    period_s: float
    offset: int
    places: Sequence[int]
    usage: str
    tables: Sequence[Sequence[Fixed]] = ()

    def wrong(self, message: str, argument: int = 0) -> FormulaError:
        """Return the error that ``argument`` is wrong."""
        return FormulaError(message, self.places[argument], self.usage)

    def of_kind(self, term: Term, dimension: Dimension, argument: int) -> float:
        """Return the value of a fixed quantity of ``dimension``.

        Raises:
            FormulaError: it has another dimension, a unit with a zero of its own, or is not above
                0.
        """
        if term.unit:
            raise FormulaError(
                f"expected a difference, found a value in {term.unit}", self.places[argument],
                f"write it in {parse_unit(term.unit).difference()}",
            )  # fmt: skip
        if term.dimension != dimension or term.constant is None:
            raise self.wrong(
                f"expected {si_symbol(dimension)}, found {dimension_text(term.dimension)}",
                argument,
            )
        if not term.constant > 0:
            raise self.wrong("expected a value above 0", argument)
        return term.constant


@dataclass(frozen=True)
class Function:
    """A function: ``usage`` for people, what it ``takes``, and how its rows are made."""

    usage: str
    takes: tuple[Kind, ...]
    make: Callable[[Call, Sequence[Term]], Term]


def _same(call: Call, first: Term, second: Term) -> Dimension:
    if not alike(first.dimension, second.dimension):
        raise call.wrong(
            f"expected {dimension_text(first.dimension)}, found {dimension_text(second.dimension)}",
            len(call.places) - 1,
        )
    return first.dimension


def _abs(call: Call, terms: Sequence[Term]) -> Term:
    return call.builder.add(Op.ABS, *terms, dimension=terms[0].dimension)


def _sqrt(call: Call, terms: Sequence[Term]) -> Term:
    dimension = terms[0].dimension
    if any(power % 2 for power in dimension):
        raise call.wrong(f"{dimension_text(dimension)} has no root with a unit")
    half = tuple(power // 2 for power in dimension)
    return call.builder.add(Op.SQRT, *terms, dimension=half)


def _of_angle(op: Op) -> Callable[[Call, Sequence[Term]], Term]:
    def make(call: Call, terms: Sequence[Term]) -> Term:
        if terms[0].dimension != _ANGLE:
            raise call.wrong(
                f"expected an angle in rad, found {dimension_text(terms[0].dimension)}"
            )
        return call.builder.add(op, *terms)

    return make


def _atan2(call: Call, terms: Sequence[Term]) -> Term:
    _same(call, *terms)
    return call.builder.add(Op.ATAN2, *terms, dimension=_ANGLE)


def _pair(op: Op) -> Callable[[Call, Sequence[Term]], Term]:
    def make(call: Call, terms: Sequence[Term]) -> Term:
        return call.builder.add(op, *terms, dimension=_same(call, *terms))

    return make


def _where(call: Call, terms: Sequence[Term]) -> Term:
    dimension = _same(call, terms[1], terms[2])
    return call.builder.add(Op.WHERE, *terms, dimension=dimension)


def _hold(call: Call, terms: Sequence[Term]) -> Term:
    return call.builder.add(Op.HOLD, *terms, dimension=terms[0].dimension)


def _deadband(call: Call, terms: Sequence[Term]) -> Term:
    band = call.of_kind(terms[1], terms[0].dimension, 1)
    return call.builder.add(Op.DEADBAND, terms[0], dimension=terms[0].dimension, parameters=(band,))


def _lookup(call: Call, terms: Sequence[Term]) -> Term:
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
    return call.builder.add(
        Op.LOOKUP, terms[0], dimension=outputs[0].dimension, parameters=xs + ys, size=len(xs)
    )


def _derivative(call: Call, terms: Sequence[Term]) -> Term:
    return call.builder.add(Op.DERIVATIVE, *terms, dimension=over(terms[0].dimension, _SECOND))


def _lowpass(call: Call, terms: Sequence[Term]) -> Term:
    frequency = call.of_kind(terms[1], _HERTZ, 1)
    most = 0.25 / call.period_s
    if frequency > most:
        raise call.wrong(
            f"a filter of {frequency:g} Hz is too fast for a cycle of {1 / call.period_s:g} Hz: "
            f"at most {most:g} Hz",
            1,
        )
    return call.builder.add(
        Op.LOWPASS, terms[0], dimension=terms[0].dimension, parameters=(2 * math.pi * frequency,)
    )


def _integral(call: Call, terms: Sequence[Term]) -> Term:
    dimension = times(terms[0].dimension, _SECOND)
    return call.builder.add(Op.INTEGRAL, *terms, dimension=dimension)


def _window(op: Op) -> Callable[[Call, Sequence[Term]], Term]:
    def make(call: Call, terms: Sequence[Term]) -> Term:
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
        return call.builder.add(
            op, terms[0], dimension=terms[0].dimension, parameters=(window_s,), size=samples
        )

    return make


def _rate_limit(call: Call, terms: Sequence[Term]) -> Term:
    rate = over(terms[0].dimension, _SECOND)
    return call.builder.add(
        Op.RATE_LIMIT,
        terms[0],
        dimension=terms[0].dimension,
        parameters=(call.of_kind(terms[1], rate, 1),),
    )


def _edges(call: Call, terms: Sequence[Term]) -> Term:
    return call.builder.add(Op.EDGES, *terms)


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
