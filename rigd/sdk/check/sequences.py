"""Plays sequences of calls at random, and shortens one that fails until each step is needed.

A sequence is drawn from a seed, so that it is the same each time. What a step does, and what must
hold after it, is up to the bench that plays it.
"""

from __future__ import annotations

import contextlib
import random
import re
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final, NamedTuple

from rigd.model.errors import DeviceError, ProtocolError
from rigd.sdk.check.caller import CallOutcome, Hung
from rigd.sdk.check.peer import Observed
from rigd.sdk.check.rows import drawn_values
from rigd.sdk.check.subject import Subject, UnfitSubject, described

#: How long a failing sequence is shortened, in s.
SHORTEN_S: Final = 10.0
#: A sequence that fails is played so often. It counts if it fails so often while this machine goes
#: on, or each time; else it is stated.
PLAYS: Final = 4
CALM: Final = 2
#: What an author is told beside a failure that only some options show.
DESCRIBES: Final = (
    "; if this option describes the device itself, as its scale does, give it to check_driver: "
    "what is given is not drawn"
)
#: With these errors a driver refuses a device that answers, and is not one of the options drawn.
REFUSALS: Final = (ProtocolError, DeviceError)
#: Until each kind of step was drawn so often, this part of the steps are of those that were not.
OFTEN: Final = 2
SELDOM_PART: Final = 0.5


class DrawnStep(NamedTuple):
    """A call, or some of one kind: its name, and what it is given."""

    name: str
    value: Any = None

    def __str__(self) -> str:
        if isinstance(self.value, Mapping):
            return f"{self.name} {', '.join(f'{k} {v:.6g}' for k, v in self.value.items())}"
        if isinstance(self.value, tuple):
            return f"{self.name} {', '.join(f'{value:.6g}' for value in self.value)}"
        return self.name if self.value is None else f"{self.name} {self.value}"


@dataclass(frozen=True)
class DrawnTrial:
    """Steps for a new driver with a new device, and the options that were drawn for it."""

    steps: tuple[DrawnStep, ...]
    options: Mapping[str, Any] = field(default_factory=dict)
    #: What its device is, is drawn from it.
    seed: str = ""
    #: Whether another driver is open beside it, with a device of its own.
    beside: bool = False

    def __str__(self) -> str:
        steps = ", ".join(map(str, self.steps))
        beside = "beside another, " if self.beside else ""
        return f"with {self.drawn}: {beside}{steps}" if self.options else f"{beside}{steps}"

    def until(self, step: int) -> DrawnTrial:
        """Return the trial with the steps up to this one."""
        return replace(self, steps=self.steps[: step + 1])

    @property
    def drawn(self) -> str:
        """The options as text."""
        return ", ".join(f"{name}: {value}" for name, value in self.options.items())


class KindOfStep(NamedTuple):
    """A kind of step: the states in which it is possible, how often it is drawn among others."""

    states: str  # separated by blanks
    weight: float
    after: str = ""  # the state after it; "": the same
    most: int = 99  # how often at most in one sequence
    #: What a driver must have for it: setpoints, watchdog, rescue, actions, channels; its device,
    #: faults that end.
    needs: str = ""
    #: "drives": the device may be driven in it; "silent": its watchdog may act, though it is armed.
    marks: str = ""


#: Returns what a step is given.
DrawValue = Callable[[Subject, random.Random], Any]


def possible(calls: Mapping[str, KindOfStep], subject: Subject) -> dict[str, KindOfStep]:
    """Return the calls that are possible with a driver of the present options."""
    declared = subject.declare()
    driven = bool(declared.setpoints)
    has = {
        "setpoints": driven,
        "watchdog": driven and declared.watchdog_s is not None,
        "rescue": driven and getattr(subject.driver_class, "second_link", False),
        "actions": declared.actions,
        "channels": declared.channels,
        "faults": subject.faults,
        "": True,
    }
    return {name: call for name, call in calls.items() if call.weight and has[call.needs]}


#: What steps of each kind of driver are given.
VALUES: Final[Mapping[str, DrawValue]] = {
    "measure": lambda subject, rng: drawn_values(subject.declare(), rng),
    "act": lambda subject, rng: rng.choice([*subject.declare().actions, "no_such_action"]),
}


@dataclass
class SequenceDrawing:
    """Draws sequences; what was drawn seldom in those before comes sooner in those after.

    ``faults`` are those with which a step `fail` is given, in turn, if the device has them.
    """

    subject: Subject
    calls: Mapping[str, KindOfStep]
    values: Mapping[str, DrawValue]
    faults: Sequence[str]
    used: Counter[str] = field(default_factory=Counter)

    def trials(self, count: int, steps: int) -> Iterator[DrawnTrial]:
        """Yield sequences of so many steps.

        The first has the options of the author alone, the next two have all others at the ends of
        their ranges.
        """
        for number in range(count):
            rng = random.Random(f"{self.subject.seed} {number}")
            ends = {1: 0, 2: -1}
            options = self.subject.drawn(rng, ends.get(number)) if number else {}
            subject = replace(self.subject, more=options)
            drawn = tuple(self._steps(subject, steps, rng))
            beside = self.subject.varies and number % 2 == 1
            yield DrawnTrial(drawn, options, str(number), beside=beside)

    def _steps(self, subject: Subject, steps: int, rng: random.Random) -> Iterator[DrawnStep]:
        calls = possible(self.calls, subject)
        left = {name: call.most for name, call in calls.items()}
        faults = [fault for fault in self.faults if fault in subject.faults]
        least = dict.fromkeys(calls, OFTEN) | {"fail": len(faults)}
        state = "closed"
        for _ in range(steps):
            names = [n for n, call in calls.items() if state in call.states.split() and left[n]]
            seldom = [name for name in names if self.used[name] < least[name]]
            names = seldom if seldom and rng.random() < SELDOM_PART else names
            (name,) = rng.choices(names, [calls[name].weight for name in names])
            draw = {**VALUES, **self.values}.get(name)
            value = faults[self.used[name] % len(faults)] if name == "fail" else None
            value = draw(subject, rng) if draw is not None else value
            yield DrawnStep(name, value)
            left[name] -= 1
            self.used[name] += 1
            state = calls[name].after or state


def in_turn(
    play: Callable[[Subject, DrawnTrial], None], *trials: Sequence[tuple[Any, ...]], seed: str = ""
) -> Callable[[Subject], Iterator[str]]:
    """Return the check that plays sequences which are not drawn, each of steps with its value."""

    def check(subject: Subject) -> Iterator[str]:
        drawn = (
            DrawnTrial(tuple(DrawnStep(*item) for item in each), {}, f"{seed}{number}")
            for number, each in enumerate(trials)
        )
        yield from first_failure(partial(play, subject), drawn, subject.notes)

    return check


class StepFailed(Exception):
    """What was seen breaks a promise; the message states what."""

    at = 10**6  #: how many steps were made before: more than there are if all were
    error: BaseException | None = None  #: what open() raised
    sure = False  #: whether no stall of this machine shows the same
    doubtful = False  #: whether this machine held the sequence back: that may show the same


def surely(problem: str) -> StepFailed:
    """Return a failure that no stall of this machine can show."""
    failed = StepFailed(problem)
    failed.sure = True
    return failed


def expect(what: str, outcome: CallOutcome) -> Any:
    """Return what a call returned; raise StepFailed if it has raised an error."""
    if (error := outcome.error) is not None:
        failed = StepFailed(f"{what} raises {described(error)}")
        failed.error = error if what == "open" else None
        raise failed
    return outcome.value


def check_identity(driver: Any, look: Observed) -> None:
    """Raise StepFailed if a driver says that its device is another."""
    if look.identity not in driver.identity:
        raise StepFailed(f"identity is {driver.identity!r}, and the device is {look.identity!r}")


class Unjudged(Exception):
    """What was seen says nothing about the driver; the message states why."""


#: Plays a trial; raises StepFailed or Unjudged.
Play = Callable[[DrawnTrial], None]


@dataclass
class RandomWalk:
    """Goes through the steps of a trial that are possible in the state that those before led to."""

    _trial: DrawnTrial
    _calls: Mapping[str, KindOfStep]
    state: str = "closed"
    _number: int = 0

    def __iter__(self) -> Iterator[DrawnStep]:
        """Yield each step; the state changes once it is made."""
        for number, step in enumerate(self._trial.steps):
            self._number = number
            call = self._calls[step.name]
            if self.state in call.states.split():
                yield step
                self.state = call.after or self.state

    @contextlib.contextmanager
    def judged(self, stalled: Callable[[], bool]) -> Iterator[None]:
        """Make of a step that fails what it tells: of the driver, perhaps, or nothing.

        ``stalled`` returns whether this machine held the sequence back until then.

        Raises:
            StepFailed: the driver breaks a promise; or, if that is doubtful, the machine does.
            Unjudged: it may be the options.
        """
        try:
            yield
        except StepFailed as failed:
            failed.at = self._number
            failed.doubtful = not failed.sure and stalled()
            if self._trial.options and isinstance(failed.error, REFUSALS):
                raise Unjudged(f"with {self._trial.drawn} {failed}") from failed
            raise


def made(player: object, step: DrawnStep) -> Any:
    """Make the calls of a step, a method of ``player`` of its name; return what they return."""
    calls = getattr(player, "_" + step.name.replace(",", "").replace(" ", "_"))
    return calls() if step.value is None else calls(step.value)


def first_failure(play: Play, trials: Iterable[DrawnTrial], notes: list[str]) -> Iterator[str]:
    """Yield what the first trial that fails shows, behind the fewest steps that show it.

    A trial that fails is played again from the beginning, with a new driver before a new device:
    a right driver passes at least once. ``notes`` gets what did not count, and what was not judged.
    """
    why: Counter[str] = Counter()
    count = 0
    for trial in trials:
        count += 1
        try:
            failed = _confirmed(play, trial, notes)
        except Unjudged as unjudged:
            why[str(unjudged)] += 1
            continue
        if failed is not None:
            shortest, problem = _shortened(play, trial, failed)
            yield f"{shortest}: {problem}{DESCRIBES if shortest.options else ''}"
            break
    notes += [f"{number} of {count} trials were not judged: {each}" for each, number in why.items()]


def _confirmed(play: Play, trial: DrawnTrial, notes: list[str]) -> StepFailed | None:
    """Return how a trial fails, if that counts.

    Raises:
        Unjudged: that cannot be told.
    """
    failures: list[StepFailed] = []
    calm: list[StepFailed] = []
    for played in range(1, PLAYS + 1):
        try:
            failed = _failure(play, trial)
        except Unjudged:
            if played == 1:
                raise
            failed = None
        failures += [] if failed is None else [failed]
        calm = [each for each in failures if not each.doubtful]
        if len(calm) == CALM or len(failures) == PLAYS:
            return (calm or failures)[0]
        if not calm and len(failures) < played:
            break  # this machine is enough to explain those before
    if failures:
        times = "once" if len(failures) == 1 else f"{len(failures)} times"
        busy = "" if calm else "while this machine was busy, "
        first = failures[0]
        notes.append(f"{busy}showed {times} in {played} times: {trial.until(first.at)}: {first}")
    return None


def _failure(play: Play, trial: DrawnTrial) -> StepFailed | None:
    """Play a trial once, and return how it fails, if it does.

    Raises:
        Unjudged: that cannot be told.
    """
    try:
        play(trial)
    except StepFailed as failed:
        return failed
    except (UnfitSubject, Hung) as unfit:
        return StepFailed(str(unfit))
    return None


def _fails(play: Play, trial: DrawnTrial, before: StepFailed) -> StepFailed | None:
    """Play a shorter trial once; return how it fails, if no machine does, or it fails as before."""
    with contextlib.suppress(Unjudged):
        failed = _failure(play, trial)
        if failed is not None and (not failed.doubtful or _words(failed) == _words(before)):
            return failed
    return None


def _words(failed: StepFailed) -> str:
    return re.sub(r"[-\d.e]+", "", str(failed))


def _shortened(play: Play, trial: DrawnTrial, failed: StepFailed) -> tuple[DrawnTrial, StepFailed]:
    """Return the shortest trial that was found to fail, and how it fails."""
    end, trial = time.monotonic() + SHORTEN_S, trial.until(failed.at)
    shorter = _less(trial)
    while (less := next(shorter, None)) is not None and time.monotonic() < end:
        if now := _fails(play, less, failed):
            trial, failed = less.until(now.at), now
            shorter = _less(trial)
    return trial, failed


def _less(trial: DrawnTrial) -> Iterator[DrawnTrial]:
    """Yield the trial without the other driver, with fewer options, with fewer steps."""
    if trial.beside:
        yield replace(trial, beside=False)
    fewer = [{name: trial.options[name]} for name in trial.options if len(trial.options) > 1]
    for options in ({}, *fewer) if trial.options else ():
        yield replace(trial, options=options)
    size = len(trial.steps) // 2
    while size:
        for first in range(len(trial.steps) - 1 - size, -1, -size):  # the last step is what fails
            yield replace(trial, steps=trial.steps[:first] + trial.steps[first + size :])
        size //= 2
