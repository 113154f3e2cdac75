"""Plays a plant through steps of random sizes, commands, settings and trials, in several ways.

The rows follow from the seed, the commands and the time alone. So a sequence is played again:
beside another plant, begun at another time, and with its time divided, where devices are also read
and written in between and read in another order. The rows stay the same. With another seed, and
with trials of other seeds, they do not.
"""

from __future__ import annotations

import contextlib
import inspect
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, get_args

import numpy as np
from pydantic import BaseModel

from rigd.model.units import format_quantity
from rigd.sdk.check.declaration_rules import unread
from rigd.sdk.check.plant.bench import CYCLE_NS, PlantBench, PlantSubject, Played, gentle
from rigd.sdk.check.plant.physics import unbalanced
from rigd.sdk.check.plant.rules import PlantRule, changes_of, needs_devices, needs_truth
from rigd.sdk.driver import Driver
from rigd.sdk.parameters import ParametersConfig

#: Sequences of one examination, and the parts of each.
SEQUENCES: Final = 4
PARTS: Final = 40
#: Sizes of a part, in cycles, all equally often.
SIZES: Final = (1, 1, 2, 3, 7, 20, 50)
#: In so many parts of 1 a setting changes, and in so many a trial begins: none before this part.
CHANGES: Final = 0.1
TRIALS: Final = 0.1
FIRST_TRIAL: Final = 10
#: How often a part is divided.
PIECES: Final = 5
#: Cycles at rest in which noise is compared, and by how many that of another seed may be later.
NOISE_CYCLES: Final = 60
SHIFTS: Final = (1, 2, 3)
#: A device has noise if so many of its rows differ from the one before.
NOISY: Final = 0.2
#: What is added to a seed to have another one.
APART: Final = 1000
#: A time of CLOCK_MONOTONIC on a machine that has run for a long time, in ns.
LATE_NS: Final = 1_700_000_000_000_000_000
#: Share of readings that may differ by the rounding of a count, and what is rounding of physics.
FLIPPED: Final = 0.005
ROUNDING: Final = 1e-6
#: Changes of settings that are compared with options; cycles before such a change, and after it.
COMPARED: Final = 8
AT_REST: Final = 50
AFTER: Final = 300
#: Seeds that show how far plants scatter, and by how much more one of them may differ.
SCATTERED: Final = 3
SCATTER: Final = 4.0
#: Units of channels that show where a body is.
PLACES: Final = frozenset({"m", "rad"})
SPEEDS: Final = frozenset({"m/s", "rad/s"})


@dataclass(frozen=True)
class TimePart:
    """A part of the time, in cycles, and what happens before it."""

    cycles: int
    trial: int | None = None
    change: tuple[str, float | str] | None = None


def _drawn(subject: PlantSubject, rng: random.Random) -> Iterator[TimePart]:
    changes = list(changes_of(subject.config().settings()))
    for number in range(PARTS):
        begins = number == FIRST_TRIAL or (number > FIRST_TRIAL and rng.random() < TRIALS)
        yield TimePart(
            rng.choice(SIZES),
            number if begins else None,
            rng.choice(changes) if changes and rng.random() < CHANGES else None,
        )


@dataclass
class _Run:
    """A plant that is played part by part, with the commands of ``seed``.

    ``apart`` is added to the seed of the plant, ``trials`` to those of the trials; time begins at
    ``start_ns``, and is ``divided`` or not.
    """

    subject: PlantSubject
    seed: int
    apart: int = 0
    trials: int = 0
    start_ns: int = 0
    divided: bool = False

    def __post_init__(self) -> None:
        self.rng = random.Random(self.seed) if self.divided else None
        plant = self.subject.make(seed=self.seed + self.apart)
        self.bench = PlantBench(self.subject, plant, start_ns=self.start_ns, rng=self.rng)

    def play(self, part: TimePart) -> Played:
        """Play a part; return all that was seen."""
        bench = self.bench
        if part.trial is not None:
            bench.plant.begin_trial(part.trial + self.trials)
        if part.change is not None:
            with contextlib.suppress(ValueError):  # not allowed with the present settings
                bench.plant.change(*part.change)
        if self.rng is not None:
            cycles = sorted(self.rng.randrange(part.cycles) for _ in range(PIECES))
            for cycle in cycles:
                bench.touch(bench.now_ns + cycle * CYCLE_NS)
        return bench.play(part.cycles, self._commands, at_once=part.cycles)

    def _commands(self, driver: Driver, cycle: int) -> Sequence[float]:
        return gentle(driver, cycle + 7919 * self.seed)


def _sequences(subject: PlantSubject) -> Iterator[str]:
    unseeded = untried = subject.plant_class.seeded
    for number in range(SEQUENCES):
        parts = list(_drawn(subject, random.Random(f"{subject.seed} {number}")))
        sizes = ", ".join(str(part.cycles) for part in parts[:5])
        seed = subject.seed + number
        whole, beside, late = (_Run(subject, seed, start_ns=at) for at in (0, 0, LATE_NS))
        divided = _Run(subject, seed, divided=True)
        other, tried = _Run(subject, seed, apart=APART), _Run(subject, seed, trials=APART)
        for part in parts:
            seen = whole.play(part)
        for part in parts:  # beside each other
            elsewhere, again, pieces = other.play(part), beside.play(part), divided.play(part)
            later, after = late.play(part), tried.play(part)
        problems = list(differing(seen, pieces, "as its time is divided"))
        for same, when in (
            (again, "if another plant is played beside it: draw noise from the seed and the time, "
             "keep nothing in the class"),
            (later, f"begun at {LATE_NS} ns: use the t_ns that evolve() is given"),
        ):  # fmt: skip
            if seen.bytes() != same.bytes():
                problems.append(f"devices show other rows {when}")
        if not any(seen.rows.values()):
            problems.append("no device gives a row")
        with contextlib.suppress(ValueError):
            divided.bench.plant.advance(divided.bench.now_ns - 1)
            problems.append("advance() to an earlier time is accepted: override evolve() instead")
        if seen.energy and not any(part.change for part in parts):
            problems += filter(None, [unbalanced(seen.energy, subject.accuracy)])
        if problems:
            yield from (f"with parts of {sizes}, ... ms {problem}" for problem in problems)
            return
        unseeded &= seen.bytes() == elsewhere.bytes()
        untried &= seen.bytes() == after.bytes()
    if subject.plant_class.seeded:
        yield from _same_noise(subject)
    if unseeded:
        yield "plants of two seeds show the same rows of all devices: draw noise from `self.seed`"
    if untried:
        yield (
            "trials of two seeds show the same rows of all devices: draw noise from `self.seed`, "
            "which begin_trial() sets"
        )


def _same_noise(subject: PlantSubject) -> Iterator[str]:
    """Yield that one seed has the noise of another one, at another time: they are added."""
    step_ns = subject.plant_class.step_ns or CYCLE_NS
    for apart in {1, CYCLE_NS // step_ns, CYCLE_NS // 1000, CYCLE_NS}:
        seen = []
        for seed in (subject.seed, subject.seed + apart):
            bench = PlantBench(subject, subject.make(seed=seed))
            seen.append(bench.play(NOISE_CYCLES, None))
        for name in seen[0].rows:
            first, other = (played.table(name) for played in seen)
            for late in SHIFTS if len(first) == len(other) > 2 * max(SHIFTS) else ():
                shifted = (first[late:] == other[:-late]).all() or (
                    first[:-late] == other[late:]
                ).all()
                if shifted and (first[1:] != first[:-1]).any(axis=1).mean() > NOISY:
                    yield (
                        f"{name} has the same noise with seeds {apart} apart, {late} cycles later: "
                        "draw it from seed and time, not from their sum"
                    )
                    return


def differing(first: Played, other: Played, when: str) -> Iterator[str]:
    """Yield where two plants of the same seed and commands differ by more than rounding."""
    for name in first.rows:
        a, b = first.table(name), other.table(name)
        if a.shape != b.shape:
            yield f"{name} gives {len(b)} rows, not {len(a)}, {when}"
            continue
        if not a.size:
            continue
        scale = np.abs(np.nan_to_num(a)).max(axis=0)
        same = (np.abs(a - b) <= ROUNDING * scale) | (np.isnan(a) & np.isnan(b))
        if 1.0 - same.mean(axis=0).min() > FLIPPED:
            column = int(same.mean(axis=0).argmin())
            far = float(np.abs(np.nan_to_num(a - b))[:, column].max())
            yield f"column {column} of {name} differs by up to {far:.3g} {when}"


def _from_the_start(subject: PlantSubject) -> Iterator[str]:
    """Compare a plant whose option gives a value to a setting with one that is changed to it.

    It is changed before time begins, and after a while without commands, if the hidden state is the
    same until then: of a plant at rest. What differs with the seed may differ: each act has its
    scatter.
    """
    settings = subject.config().settings()
    names = [name for name in settings if name in subject.plant_class.Config.model_fields]
    changes = [item for item in changes_of(settings) if item[0] in names]
    random.Random(subject.seed).shuffle(changes)
    for name, value in changes[:COMPARED]:
        text = value if isinstance(value, str) else format_quantity(value, settings[name].unit, 12)
        given = replace(subject, options={**subject.options, name: text})
        for wait in (0, AT_REST):
            benches = []
            with contextlib.suppress(ValueError):  # not allowed with the other options, or now
                benches = [PlantBench(item, item.make()) for item in (given, subject)]
                for bench in benches:
                    bench.play(wait, None)
                benches[1].plant.change(name, value)
                for bench in benches:
                    bench.look()
            if len(benches) < 2 or _apart(subject, *(bench.seen for bench in benches)):
                break
            first, other = (bench.play(AFTER, gentle) for bench in benches)
            if (far := _apart(subject, first, other)) and not _scatters(given, wait, first, other):
                yield f"{name} at {text} from the start, and set after {wait} ms: {far}"
                break


def _moves_nothing(subject: PlantSubject) -> Iterator[str]:
    """Read places, angles and speeds before and after a setting is changed, at one time."""
    settings = subject.config().settings()
    for change in changes_of({name: item for name, item in settings.items() if not item.moves}):
        bench = PlantBench(subject, subject.make())
        bench.play(AFTER, gentle)
        bench.look()
        seen = {name: rows[-1:] for name, rows in bench.seen.rows.items()}
        bench.seen.rows = {name: [] for name in seen}
        with contextlib.suppress(ValueError):  # not allowed with the other options, or now
            bench.plant.change(*change)
        bench.look()
        for name, driver in bench.devices.items():
            rows = [*seen[name], *bench.seen.rows[name][:1]]  # a card gives none at the same time
            for number, channel in enumerate(driver.declaration.channels if len(rows) > 1 else ()):
                before, after = rows[0][number], rows[1][number]
                units = SPEEDS if name == subject.truth else PLACES | SPEEDS
                if channel.unit in units and before != after:
                    yield (
                        f"{name}.{channel.name} jumps from {before:g} to {after:g} {channel.unit} "
                        f"as {change[0]} is set to {change[1]}"
                    )


def _apart(subject: PlantSubject, first: Played, other: Played) -> str:
    """Return how the hidden state of two plants differs; "" if it does not."""
    rows = [{subject.truth: played.rows[subject.truth]} for played in (first, other)]
    return next(differing(Played(rows[0]), Played(rows[1]), "from one to the other"), "")


def _scatters(subject: PlantSubject, wait: int, first: Played, other: Played) -> bool:
    """Return whether the hidden state differs no more than that of plants of other seeds."""
    truth = first.table(subject.truth)
    spread = [np.zeros(truth.shape[1])]
    for seed in range(2, 2 + SCATTERED):
        bench = PlantBench(subject, subject.make(seed=seed))
        bench.play(wait, None)
        bench.look()
        spread.append(abs(bench.play(AFTER, gentle).table(subject.truth) - truth).max(axis=0))
    far = abs(other.table(subject.truth) - truth).max(axis=0)
    return bool(np.all(far <= SCATTER * np.max(spread, axis=0)))


def _all_read(subject: PlantSubject) -> Iterator[str]:
    PlantBench(subject, subject.make()).play(AFTER, gentle)  # imports what it needs
    config = subject.config()
    devices = [driver_class for driver_class, _ in subject.devices.values()]
    users = [*inspect.getmro(subject.plant_class), *devices]
    groups = [type(config)]
    if isinstance(config, ParametersConfig):
        groups += dict.fromkeys(_groups(config.parameter_model()))
    for group in groups:
        for name in unread(group, users):
            yield f"nothing reads {name} of {group.__name__}"


def _groups(annotation: Any) -> Iterator[type[Any]]:
    """Yield the models in the type of a field, and in those of their fields."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
        for field in annotation.model_fields.values():
            yield from _groups(field.annotation)
    for item in get_args(annotation):
        yield from _groups(item)


RULES: Final = (
    PlantRule(
        "any sequence",
        "the seed, the commands and the time give the rows, however time is divided, and however "
        "often and in which order devices are read and written: step on a grid (GridPlant), follow "
        "setpoints by time, draw noise of seed and time by normal_pair(); call advance() in read()",
        _sequences,
        needs_devices,
    ),
    PlantRule(
        "settings from the start",
        "an option is the value of its setting at the start: what is changed later acts as well",
        _from_the_start,
        needs_truth,
    ),
    PlantRule(
        "settings move nothing",
        "change() alters a setting at once, and bodies stay where they are and keep their speed, "
        "unless its Setting says that it `moves` them",
        _moves_nothing,
        needs_devices,
    ),
    PlantRule(
        "everything is read",
        "use every option and parameter, or remove it: the person who gives it relies on it",
        _all_read,
        needs_devices,
    ),
)
