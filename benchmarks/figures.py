"""The one line by which a benchmark reports a figure; ``all.py`` gathers these lines in a table."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence

PREFIX = "figure:"


def at_least(name: str, value: float, target: float, unit: str = "x") -> None:
    """Report a figure that should be ``target`` or more."""
    _line(name, value, f">= {target:g}", unit, value >= target)


def at_most(name: str, value: float, target: float, unit: str = "x") -> None:
    """Report a figure that should be ``target`` or less."""
    _line(name, value, f"<= {target:g}", unit, value <= target)


def noted(name: str, value: float, unit: str) -> None:
    """Report a figure without a target."""
    _line(name, value, "", unit, None)


def _line(name: str, value: float, target: str, unit: str, met: bool | None) -> None:
    verdict = "" if met is None else "ok" if met else "MISSED"
    print(f"{PREFIX} {name} | {value:.4g} {unit} | {target} | {verdict}", flush=True)


def in_turn(plays: Sequence[Callable[[], float]], rounds: int) -> list[tuple[float, float, float]]:
    """Return for each of ``plays`` its median, and how much it adds to the first, and its ratio.

    All are played in every round, in alternating order, and compared within the round: the speed of
    a machine that others use changes within seconds.
    """
    found = []
    for number in range(rounds):
        order = plays if number % 2 == 0 else plays[::-1]
        once = [play() for play in order]
        found.append(once if number % 2 == 0 else once[::-1])
    return [
        (
            statistics.median(row[n] for row in found),
            statistics.median(row[n] - row[0] for row in found),
            statistics.median(row[n] / row[0] for row in found),
        )
        for n in range(len(plays))
    ]
