"""Expressions drawn at random, each with its value and dimension by a second, simple way.

The second way knows nothing of :mod:`rigd.language`: Python's own `eval` of plain floats in SI
gives the value, a dictionary of powers the dimension.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from random import Random
from typing import Final

Powers = dict[str, int]

#: A unit as written: its size in SI, and the powers of m, kg, s, A, rad.
UNITS: Final[dict[str, tuple[float, Powers]]] = {
    "": (1.0, {}),
    "m": (1.0, {"m": 1}),
    "mm": (1e-3, {"m": 1}),
    "s": (1.0, {"s": 1}),
    "ms": (1e-3, {"s": 1}),
    "A": (1.0, {"A": 1}),
    "N": (1.0, {"kg": 1, "m": 1, "s": -2}),
    "N m": (1.0, {"kg": 1, "m": 2, "s": -2}),
    "m/s": (1.0, {"m": 1, "s": -1}),
    "m/s^2": (1.0, {"m": 1, "s": -2}),
    "1/s": (1.0, {"s": -1}),
    "kg·m²": (1.0, {"kg": 1, "m": 2}),
    "rad": (1.0, {"rad": 1}),
    "%": (0.01, {}),
}
#: Names and what they are: SI value and unit.
NAMES: Final = {"force": (3.5, "N"), "way": (0.25, "m"), "pace": (-1.5, "m/s"), "share": (0.5, "")}
_NUMBERS: Final = ("1", "2", "0.5", "3.25", "1e3", ".5", "4.", "12", "1e-2", "2E2")


class Refused(Exception):
    """The second way has no value: units do not fit, or a division by zero."""


@dataclass(frozen=True)
class Drawn:
    """An expression as ``text``, and as ``plain`` for `eval`, in brackets throughout.

    ``powers`` is None if its units do not fit; ``level`` is how tightly ``text`` binds.
    """

    text: str
    plain: str
    powers: Powers | None
    level: int = 4


#: How tightly a text binds.
_SUM, _PRODUCT, _SIGNED, _POWER = range(4)


def draw(random: Random, depth: int = 4, *, bare: bool = False) -> Drawn:
    """Return an expression; ``bare``: its names are channels ``a.force``, not ``${force}``."""
    return _Drawing(random, bare).quantity(depth)


def value_of(drawn: Drawn, names: Mapping[str, float]) -> float:
    """Return the value in SI by Python.

    Raises:
        Refused: units do not fit, a division by zero, or a value that is not finite.
    """
    if drawn.powers is None:
        raise Refused
    known = {"sqrt": math.sqrt, "sin": math.sin, "cos": math.cos, "atan2": math.atan2}
    scope = {"__builtins__": {}, "abs": abs, "min": min, "max": max, **known, **names}
    try:
        value = float(eval(drawn.plain, scope))
    except (ZeroDivisionError, ValueError, OverflowError) as error:
        raise Refused from error
    if not math.isfinite(value):
        raise Refused
    return value


class _Drawing:
    def __init__(self, random: Random, bare: bool) -> None:
        self.random, self.bare = random, bare

    def quantity(self, depth: int) -> Drawn:
        kind = self.random.random()
        if depth == 0 or kind < 0.25:
            return self.leaf()
        if kind < 0.7:
            return self.joined(depth)
        if kind < 0.8:
            inside = self.quantity(depth - 1)
            sign = self.random.choice(("-", "+", "- "))
            text = f"{sign}{self.within(inside, _SIGNED)}"
            return Drawn(text, f"({sign}({inside.plain}))", inside.powers, _SIGNED)
        if not self.bare:
            return self.leaf()
        return self.call(depth) if kind < 0.93 else self.power(depth)

    def within(self, part: Drawn, level: int) -> str:
        """Return the text of ``part`` where it must bind as ``level``, in brackets if needed."""
        needed = part.level < level or self.random.random() < 0.2
        return f"({part.text})" if needed else part.text

    def leaf(self) -> Drawn:
        if self.random.random() < 0.3:
            name = self.random.choice(list(NAMES))
            text = (
                f"a.{name}" if self.bare else self.random.choice((f"${{{name}}}", f"${{ {name} }}"))
            )
            return Drawn(text, name, UNITS[NAMES[name][1]][1])
        number = self.random.choice(_NUMBERS)
        unit = self.random.choice(list(UNITS))
        size, powers = UNITS[unit]
        space = " " if unit.startswith("1") else self.random.choice(("", " ", "  "))
        return Drawn(f"{number}{space}{unit}".rstrip(), f"({number} * {size!r})", powers)

    def joined(self, depth: int) -> Drawn:
        left, right = self.quantity(depth - 1), self.quantity(depth - 1)
        sign = self.random.choice("+-*/")
        if sign == "/" and self.random.random() < 0.1:
            right = Drawn("0", "0.0", {})
        if sign in "+-" and self.random.random() < 0.8:  # most sums have parts that fit
            right = self.alike(left, right)
        level = _SUM if sign in "+-" else _PRODUCT
        text = f"{self.within(left, level)} {sign} {self.within(right, level + 1)}"
        powers = None
        if left.powers is not None and right.powers is not None:
            powers = _joined(sign, left.powers, right.powers)
        return Drawn(text, f"({left.plain} {sign} {right.plain})", powers, level)

    def alike(self, left: Drawn, right: Drawn) -> Drawn:
        """Return a part with the dimension of ``left``."""
        number = self.random.choice(("1", "2", "-0.5"))
        text = f"{number} * {self.within(left, _SIGNED)}"
        return Drawn(text, f"({number} * {left.plain})", left.powers, _PRODUCT)

    def call(self, depth: int) -> Drawn:
        first = self.quantity(depth - 1)
        name = self.random.choice(("abs", "sqrt", "min", "max", "sin", "atan2"))
        powers = first.powers
        if name in ("min", "max", "atan2"):
            second = self.alike(first, first)
            inside = (f"{first.text}, {second.text}", f"{first.plain}, {second.plain}")
            powers = {"rad": 1} if name == "atan2" and powers is not None else powers
        else:
            inside = (first.text, first.plain)
        if name == "sqrt" and powers is not None:
            odd = any(power % 2 for power in powers.values())
            powers = None if odd else {base: power // 2 for base, power in powers.items()}
        if name == "sin" and powers is not None:
            powers = {} if powers == {"rad": 1} else None
        return Drawn(f"{name}({inside[0]})", f"{name}({inside[1]})", powers)

    def power(self, depth: int) -> Drawn:
        base, power = self.quantity(depth - 1), self.random.choice((2, 3, 4))
        powers = base.powers
        if powers is not None:
            powers = {name: power * value for name, value in powers.items()}
        plain = " * ".join([base.plain] * power)
        return Drawn(f"{self.within(base, 4)} ** {power}", f"({plain})", powers, _POWER)


def _joined(sign: str, left: Powers, right: Powers) -> Powers | None:
    if sign in "+-":
        if left == right:
            return left
        bare_left, bare_right = _bare(left), _bare(right)
        return bare_left if bare_left == bare_right else None
    way = 1 if sign == "*" else -1
    powers = {base: left.get(base, 0) + way * right.get(base, 0) for base in {*left, *right}}
    return {base: power for base, power in powers.items() if power}


def _bare(powers: Powers) -> Powers:
    """Return the powers without the radian if there is a length: ``m/s`` and ``m rad/s`` add."""
    return {b: p for b, p in powers.items() if b != "rad"} if powers.get("m") else powers
