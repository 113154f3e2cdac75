"""Reads quantities whose unit follows from bodies; collects what is wrong with a description."""

from __future__ import annotations

import math
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Final

from rigd.model.units import format_quantity, parse_quantity, parse_unit
from rigd.sdk import In, WrongEntries

Path = tuple[str | int, ...]
#: Largest number in SI of any quantity: beyond, nothing is a bench.
LARGEST: Final = 1e12


class Wrong(Exception):  # ends one entry; never leaves the assembly
    """An entry cannot be assembled; what is wrong with it is noted."""


class Notes:
    """What is wrong with a description, by entry."""

    def __init__(self) -> None:
        self.problems: list[tuple[Path, str]] = []

    def add(self, path: Path, text: str) -> None:
        """Note what is wrong with the entry at ``path``."""
        self.problems.append((path, text))

    def refuse(self, path: Path, text: str) -> Wrong:
        """Note it and return what ends the assembly of this entry."""
        self.add(path, text)
        return Wrong()

    def raise_any(self) -> None:
        """Raise what was noted.

        Raises:
            WrongEntries: something was.
        """
        if self.problems:
            raise WrongEntries(self.problems)

    def amount(
        self,
        path: Path,
        text: str | None,
        unit: str,
        *,
        low: float = 0.0,
        high: float = LARGEST,
        above: bool = False,
        difference: bool = False,
    ) -> float:
        """Return a quantity of the kind of ``unit`` in SI; 0 needs no unit.

        ``above`` refuses ``low`` itself; ``difference``: it is how far two values are apart.

        Raises:
            Wrong: it is missing, of another kind, or not from ``low`` to ``high``.
        """
        if text is None:
            *place, key = path
            raise self.refuse(tuple(place), f"'{key}' is missing here, in {unit}")
        try:
            value = 0.0 if _is_zero(text) else In(unit, difference=difference).read(text)
        except ValueError as error:
            raise self.refuse(path, str(error)) from None
        if not math.isfinite(value) or not (low < value if above else low <= value):
            word = "more than" if above else "at least"
            bound = "0" if low == 0.0 else format_quantity(low, unit)
            raise self.refuse(path, f"'{text}' must be {word} {bound}")
        if value > high:
            raise self.refuse(path, f"'{text}' must be at most {format_quantity(high, unit)}")
        return value

    def signed(self, path: Path, text: str | None, unit: str, *, difference: bool = False) -> float:
        """Return a quantity of either sign; raises as :meth:`amount`."""
        return self.amount(path, text, unit, low=-1e6, high=1e6, difference=difference)

    def force(self, path: Path, text: str, gravity: float) -> tuple[float, float, str]:
        """Return force or weight in N, the number as given in SI, and ``N`` or ``kg``.

        Raises:
            Wrong: it is neither a force nor a mass, or negative.
        """
        try:
            given = parse_quantity(text).unit
        except ValueError as error:
            raise self.refuse(path, str(error)) from None
        unit = "kg" if given.same_kind(parse_unit("kg")) else "N"
        if unit == "N" and not given.same_kind(parse_unit("N")) and not _is_zero(text):
            has = "has no unit" if given.same_kind(parse_unit("1")) else f"is in {given}"
            raise self.refuse(
                path, f"'{text}' {has}, expected a mass or a force, such as '2 kg' or '20 N'"
            )
        number = self.amount(path, text, unit, high=1e6)
        return number * (gravity if unit == "kg" else 1.0), number, unit

    def known(self, path: Path, name: str, among: Iterable[str], kind: str) -> None:
        """Refuse a name that is not ``among`` the known ones.

        Raises:
            Wrong: it is not.
        """
        names = sorted(among)
        if name in names:
            return
        near = get_close_matches(name, names, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(names) or 'none'}"
        raise self.refuse(path, f"no {kind} {name!r}; {hint}")


def _is_zero(text: str) -> bool:
    try:
        return float(text) == 0.0
    except ValueError:
        return False
