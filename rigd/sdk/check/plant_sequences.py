"""Plays a plant through steps of random sizes, commands, settings and trials.

However the time is divided, and whatever else is played beside it, the same seed and the same
commands give the same rows; and energy balances in all of it.
"""

from __future__ import annotations

import contextlib
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from rigd.sdk.check.plant_bench import CYCLE_NS, PlantBench, PlantSubject, Played, gentle
from rigd.sdk.check.plant_physics import unbalanced
from rigd.sdk.check.plant_rules import PlantRule, changes_of, differing, needs_devices
from rigd.sdk.driver import Driver

#: Sequences of one examination, the seed of the first, and the parts of each.
SEQUENCES: Final = 4
PARTS: Final = 40
#: Sizes of a part, in cycles, all equally often.
SIZES: Final = (1, 1, 2, 3, 7, 20, 50)
#: In so many parts of 1 a setting changes, and in so many a trial begins.
CHANGES: Final = 0.1
TRIALS: Final = 0.1


@dataclass(frozen=True)
class TimePart:
    """A part of the time, in cycles, and what happens before it."""

    cycles: int
    trial: int | None = None
    change: tuple[str, float | str] | None = None


def _drawn(subject: PlantSubject, rng: random.Random) -> Iterator[TimePart]:
    changes = list(changes_of(subject.config().settings()))
    for number in range(PARTS):
        yield TimePart(
            rng.choice(SIZES),
            number if rng.random() < TRIALS else None,
            rng.choice(changes) if changes and rng.random() < CHANGES else None,
        )


class _Run:
    """A plant that is played part by part, with commands of its seed."""

    def __init__(self, subject: PlantSubject, seed: int, *, divided: bool) -> None:
        self._seed = seed
        self._bench = PlantBench(subject, subject.make(seed=seed))
        self._rng = random.Random(seed) if divided else None

    def play(self, part: TimePart) -> Played:
        """Play a part, divided at random if so is this run; return all that was seen."""
        bench = self._bench
        if part.trial is not None:
            bench.plant.begin_trial(part.trial)
        if part.change is not None:
            with contextlib.suppress(ValueError):  # not allowed with the present settings
                bench.plant.change(*part.change)
        if self._rng is not None:
            for cycle in sorted(self._rng.randrange(part.cycles) for _ in range(5)):
                bench.plant.advance(bench.now_ns + cycle * CYCLE_NS)
        return bench.play(part.cycles, self._commands, at_once=part.cycles)

    def _commands(self, driver: Driver, cycle: int) -> Sequence[float]:
        return gentle(driver, cycle + 7919 * self._seed)


def _divided(subject: PlantSubject) -> Iterator[str]:
    for number in range(SEQUENCES):
        parts = list(_drawn(subject, random.Random(f"{subject.seed} {number}")))
        sizes = ", ".join(str(part.cycles) for part in parts[:5])
        seed = subject.seed + number
        whole, again, divided, other = (
            _Run(subject, seed + apart, divided=pieces)
            for apart, pieces in ((0, False), (0, False), (0, True), (100, False))
        )
        for part in parts:
            seen = whole.play(part)
        for part in parts:  # beside each other
            other.play(part)
            beside, pieces = again.play(part), divided.play(part)
        problems = list(differing(seen, pieces))
        if seen.bytes() != beside.bytes():
            problems.append("the rows are others if another plant is played beside it")
        if seen.energy and not any(part.change for part in parts):
            problems += filter(None, [unbalanced(seen.energy, subject.accuracy)])
        if problems:
            yield from (f"with parts of {sizes}, ... ms {problem}" for problem in problems)
            return


RULES: Final = (
    PlantRule(
        "time divided",
        "how time is divided into calls of advance(), and what is played beside it, changes "
        "rounding at most: step on a grid (GridPlant), draw noise by time, "
        "keep nothing in the class",
        _divided,
        needs_devices,
    ),
)
