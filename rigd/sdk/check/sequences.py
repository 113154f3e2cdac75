"""Plays sequences of calls at random, and shortens one that fails until each step is needed.

A sequence is drawn from a seed, so that it is the same each time. What a step does, and what must
hold after it, is up to the bench that plays it.
"""

from __future__ import annotations

import random
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

from rigd.sdk.check.caller import Hung
from rigd.sdk.check.subject import Subject, UnfitSubject

#: How long a failing sequence is shortened, in s.
SHORTEN_S: Final = 10.0
#: So often a sequence is played again if the machine stalled in it.
TRIES: Final = 4
#: What an author is told beside a failure that only some options show.
DESCRIBES: Final = (
    "; if this option describes the device itself, as its scale does, give it to check_driver: "
    "what is given is not drawn"
)
#: What was drawn less often than this before is drawn so many times more often.
OFTEN: Final = 2
SELDOM: Final = 5


class Step(NamedTuple):
    """A call, or some of one kind: its name, and what it is given."""

    name: str
    value: Any = None

    def __str__(self) -> str:
        if isinstance(self.value, tuple):
            return f"{self.name} {', '.join(f'{value:.6g}' for value in self.value)}"
        return self.name if self.value is None else f"{self.name} {self.value}"


@dataclass(frozen=True)
class Trial:
    """Steps for a new driver with a new device, and the options that were drawn for it."""

    steps: tuple[Step, ...]
    options: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        options = ", ".join(f"{name}: {value}" for name, value in self.options.items())
        steps = ", ".join(map(str, self.steps))
        return f"with {options}: {steps}" if options else steps


class Call(NamedTuple):
    """A kind of step: the states in which it is possible, how often it is drawn among others."""

    states: str  # separated by blanks
    weight: float
    after: str = ""  # the state after it; "": the same
    most: int = 99  # how often at most in one sequence


@dataclass
class Drawing:
    """Draws sequences; what was drawn seldom in those before comes sooner in those after.

    ``value(name, options, rng)`` returns what a step is given.
    """

    subject: Subject
    calls: Callable[[Subject], Mapping[str, Call]]
    value: Callable[[str, Subject, random.Random], Any]
    used: Counter[str] = field(default_factory=Counter)

    def trials(self, count: int, steps: int) -> Iterator[Trial]:
        """Yield sequences of so many steps, the first with the options of the author alone."""
        for number in range(count):
            rng = random.Random(f"{self.subject.seed} {number}")
            options = self.subject.drawn(rng) if number else {}
            subject = replace(self.subject, more=options)
            yield Trial(tuple(self._steps(subject, steps, rng)), options)

    def _steps(self, subject: Subject, steps: int, rng: random.Random) -> Iterator[Step]:
        calls = self.calls(subject)
        left = {name: call.most for name, call in calls.items()}
        state = "closed"
        for number in range(steps):
            names = [n for n, call in calls.items() if state in call.states.split() and left[n]]
            weights = [calls[n].weight * (SELDOM if self.used[n] < OFTEN else 1) for n in names]
            (name,) = rng.choices(names, weights) if number else ["open"]
            left[name] -= 1
            self.used[name] += 1
            yield Step(name, self.value(name, subject, rng))
            state = calls[name].after or state


class Failed(Exception):
    """What was seen breaks a promise; the message states what, ``at`` counts the steps before."""

    at = 0


class Stalled(Exception):
    """The machine stood still: what was seen says nothing about the driver."""


#: Plays a trial; raises Failed or Stalled.
Play = Callable[[Trial], None]


def first_failure(play: Play, trials: Iterable[Trial]) -> Iterator[str]:
    """Yield what the first trial that fails shows, behind the fewest steps that show it.

    A failure counts if it shows itself twice: the machine may have stalled.
    """
    for trial in trials:
        if _failure(play, trial) and (failed := _failure(play, trial)):
            shortest, problem = _shortened(play, trial, failed)
            yield f"{shortest}: {problem}{DESCRIBES if shortest.options else ''}"
            return


def _failure(play: Play, trial: Trial) -> Failed | None:
    for _ in range(TRIES):
        try:
            play(trial)
        except Failed as failed:
            return failed
        except (UnfitSubject, Hung) as unfit:
            shown = Failed(str(unfit))
            shown.at = len(trial.steps)
            return shown
        except Stalled:
            continue
        return None
    return None


def _shortened(play: Play, trial: Trial, failed: Failed) -> tuple[Trial, Failed]:
    """Return the shortest trial that was found to fail, and how it fails."""
    end = time.monotonic() + SHORTEN_S
    trial = replace(trial, steps=trial.steps[: failed.at + 1])
    for shorter in _without_options(trial):
        if time.monotonic() < end and (now := _failure(play, shorter)):
            trial, failed = replace(shorter, steps=shorter.steps[: now.at + 1]), now
    size = len(trial.steps) // 2
    while size and time.monotonic() < end:
        first = len(trial.steps) - 1 - size  # the last step is what fails
        while first >= 0 and time.monotonic() < end:
            shorter = replace(trial, steps=trial.steps[:first] + trial.steps[first + size :])
            if now := _failure(play, shorter):
                trial, failed = replace(shorter, steps=shorter.steps[: now.at + 1]), now
                first = min(first, len(trial.steps) - 1)
            first -= size
        size //= 2
    return trial, failed


def _without_options(trial: Trial) -> Iterator[Trial]:
    if trial.options:
        yield replace(trial, options={})
    for name in trial.options if len(trial.options) > 1 else ():
        yield replace(trial, options={name: trial.options[name]})
