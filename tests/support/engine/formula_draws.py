"""Formulas of the channels ``dev_a.x`` and ``dev_b.x``, drawn at random."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import dataclass

from hypothesis import assume
from hypothesis import strategies as st
from support.engine.formula_reference import Part

from rigd.language.syntax import MAX_LENGTH

numbers = st.sampled_from([-3.0, -0.5, 0.25, 1.0, 2.0]).map(lambda x: Part("number", number=x))
leaves = st.one_of(st.builds(Part, st.sampled_from(["a", "b"])), numbers)


def joined(kinds: list[str], *parts: st.SearchStrategy[Part]) -> st.SearchStrategy[Part]:
    return st.builds(lambda kind, *inside: Part(kind, inside), st.sampled_from(kinds), *parts)


#: Parts without rounding: both forms agree on which of two is larger, and on what is zero.
exact = st.one_of(
    leaves, joined(["+", "-", "*", "min", "max"], leaves, leaves), joined(["abs"], leaves),
    leaves.map(lambda part: Part("delay", (part,), 0.004)),
    leaves.map(lambda part: Part("highest", (part,), 0.004)),
)  # fmt: skip
#: Those that are no fixed value, which has no root or no quotient at all.
changing = exact.filter(lambda part: "dev_" in part.text())
compared = joined(["<", "<="], exact, exact)
conditions = st.one_of(
    compared, joined(["and", "or"], compared, compared), joined(["not"], compared)
)


def wider(parts: st.SearchStrategy[Part]) -> st.SearchStrategy[Part]:
    fixed = st.sampled_from(
        [("lowpass", 20.0), ("lowpass", 250.0), ("ratelimit", 40.0), ("deadband", 0.5)]
        + [(kind, window) for kind in ("mean", "rms", "highest", "lowest", "delay")
           for window in (0.001, 0.004, 0.0075)]
    )  # fmt: skip
    return st.one_of(
        joined(["+", "-", "*", "min", "max"], parts, parts),
        joined(["/"], parts, changing),
        joined(["negative", "abs", "derivative", "integral"], parts),
        joined(["sqrt", "sin", "cos", "tan", "lookup"], changing),
        joined(["atan2"], leaves, leaves),  # elsewhere a zero may differ in its sign
        st.builds(lambda x, power: Part("**", (x,), power), parts, st.sampled_from([2.0, 3.0])),
        st.builds(lambda f, x: Part(f[0], (x,), f[1]), fixed, parts),
        joined(["where"], conditions, parts, parts),
        joined(["hold"], parts, conditions),
        joined(["edges"], conditions),
    )


formulas = st.recursive(leaves, wider, max_leaves=6).filter(
    lambda part: len(part.text()) <= MAX_LENGTH
)


#: The parts of each kind in which a value may be off by rounding; without a place, all.
_ROUNDED = {"/": (0,), "where": (1, 2), "hold": (0,)} | dict.fromkeys(
    ["+", "-", "*", "min", "max", "negative", "abs", "derivative", "integral", "**", "lowpass",
     "ratelimit", "deadband", "mean", "rms", "highest", "lowest", "delay"], (0, 1),
)  # fmt: skip
#: Of a channel with all that it uses: each makes a rounding error a thousand times larger.
_MOST_DERIVATIVES = 2


@dataclass(frozen=True)
class DrawnChannel:
    """A channel of `derived` with its keys; ``part`` is its value, ``line`` it in the rig file."""

    name: str
    part: Part
    line: str


@st.composite
def channels(draw: st.DrawFn) -> list[DrawnChannel]:
    """Draw channels of sensors and of channels before them, with and without the keys."""
    made: list[DrawnChannel] = []
    for number in range(draw(st.integers(1, 4))):
        part = draw(formulas.map(deepcopy).filter(lambda part: "dev_" in part.text()))
        _refer(draw, part, made)
        keys = [f'is: "{part.text()}"']
        if draw(st.booleans()):
            condition = deepcopy(draw(conditions.filter(lambda part: "dev_" in part.text())))
            keys.append(f'where: "{condition.text()}"')
            part = Part("where", (condition, part, Part("number", number=math.nan)))
        if draw(st.booleans()):
            hertz = draw(st.sampled_from([20.0, 250.0]))
            keys.append(f"lowpass: {hertz} Hz")
            part = Part("lowpass", (part,), hertz)
        if _count(part, "derivative") <= _MOST_DERIVATIVES:
            name = f"d{number}.x"
            made.append(DrawnChannel(name, part, f"  {name}: {{{', '.join(keys)}}}\n"))
    assume(made)
    return made


def _refer(draw: st.DrawFn, part: Part, known: list[DrawnChannel]) -> None:
    """Put channels in place of some of the sensors, where rounding changes no decision."""
    parts = list(part.parts)
    for place in _ROUNDED.get(part.kind, ()):
        if place >= len(parts):
            break
        if parts[place].kind in ("a", "b") and known and draw(st.booleans()):
            other = draw(st.sampled_from(known))
            number = float(other.name[1])
            parts[place] = Part("channel", (deepcopy(other.part),), number)
        else:
            _refer(draw, parts[place], known)
    part.parts = tuple(parts)


def _count(part: Part, kind: str) -> int:
    return (part.kind == kind) + sum(_count(inside, kind) for inside in part.parts)
