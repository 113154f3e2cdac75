"""Recordings that are copied with other rows, events or metadata, as a broken sensor makes them.

Every copy is a sound MCAP file. What is wrong is its content.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.analysis import Options
from rigd.analysis.evaluation import evaluate
from rigd.model.errors import RigdError
from rigd.record import NO_TRIAL, Attachment, Event, Recording, RecordingWriter

Rows = NDArray[np.void]
Metadata = dict[str, dict[str, str]]


@dataclass
class Content:
    """What a recording holds; to be changed before it is written again."""

    recording: Recording
    rows: dict[str, Rows]
    events: list[Event]
    metadata: Metadata

    @classmethod
    def of(cls, path: Path) -> Content:
        """Return what the recording at ``path`` holds."""
        recording = Recording.open(path)
        metadata = {name: dict(items) for name, items in recording.metadata.items()}
        rows = {name: recording.read(name) for name in recording.streams}
        return cls(recording, rows, recording.events(), metadata)

    def copy(self) -> Content:
        """Return a copy that can be changed."""
        metadata = {name: dict(items) for name, items in self.metadata.items()}
        rows = {name: rows.copy() for name, rows in self.rows.items()}
        return replace(self, rows=rows, events=list(self.events), metadata=metadata)

    def write(self, path: Path, *attached: Attachment) -> Path:
        """Write a recording with this content to ``path``, and ``attached`` beside its files."""
        with RecordingWriter.create(
            path,
            streams=list(self.recording.streams.values()),
            metadata={name: items for name, items in self.metadata.items() if name != "rigd"},
            attachments=[*self.recording.attachments.values(), *attached],
            start_ns=self.recording.start_ns,
            compression="none",
            sync_interval_s=None,
        ) as writer:
            for name, rows in self.rows.items():
                if len(rows):
                    writer.write(name, rows)
            for event in self.events:
                trial = None if event.trial == NO_TRIAL else event.trial
                writer.event(event.t_ns, event.kind, trial, event.data)
        return path

    def plan(self, part: str) -> Any:
        """Return a part of the plan of the identification."""
        return json.loads(self.metadata["identify"][part])

    def set_plan(self, part: str, value: Any) -> None:
        """Give the plan another part."""
        self.metadata["identify"][part] = json.dumps(value)


Random = np.random.Generator
Spoil = Callable[[Content, Random], str]


def _channel(content: Content, random: Random) -> tuple[str, str]:
    """Return a stream and a channel of it that the identification reads."""
    signals = sorted(content.plan("signals").values())
    stream, _, channel = str(random.choice(signals)).partition(".")
    return stream, channel


def _stretch(rows: Rows, random: Random) -> slice:
    """Return some or all of the rows."""
    if random.random() < 0.3:
        return slice(None)
    begin, end = sorted(random.integers(0, len(rows) + 1, 2))
    return slice(int(begin), int(end))


def _values(name: str, change: Callable[[NDArray[np.float64], Random], Any]) -> Spoil:
    def spoil(content: Content, random: Random) -> str:
        stream, channel = _channel(content, random)
        rows = content.rows[stream]
        part = _stretch(rows, random)
        raw = f"{channel}_raw"
        for item in (channel, raw):
            if item in (rows.dtype.names or ()):
                rows[item][part] = change(rows[item][part].copy(), random)
        return f"{name}: {stream}.{channel} {part}"

    return spoil


def _spikes(values: NDArray[np.float64], random: Random) -> NDArray[np.float64]:
    hit = random.random(len(values)) < 10.0 ** random.uniform(-4, -1)
    values[hit] += 10.0 ** random.uniform(-2, 6) * random.standard_normal(int(hit.sum()))
    return values


def _jump(values: NDArray[np.float64], random: Random) -> NDArray[np.float64]:
    if len(values):
        values[int(random.integers(len(values))) :] += random.standard_normal()
    return values


def _times(name: str, change: Callable[[NDArray[np.uint64], Random], Any]) -> Spoil:
    def spoil(content: Content, random: Random) -> str:
        stream, _ = _channel(content, random)
        rows = content.rows[stream]
        part = _stretch(rows, random)
        rows["t_ns"][part] = change(rows["t_ns"][part].astype(np.int64), random)
        return f"{name}: {stream} {part}"

    return spoil


def _rows(name: str, change: Callable[[Rows, Random], Rows]) -> Spoil:
    def spoil(content: Content, random: Random) -> str:
        stream, _ = _channel(content, random)
        if len(rows := content.rows[stream]):  # another way may have emptied it
            content.rows[stream] = change(rows, random)
        return f"{name}: {stream}"

    return spoil


def _constant(content: Content, random: Random) -> str:
    constants = content.plan("constants")
    numbers = sorted(k for k, value in constants.items() if isinstance(value, int | float))
    name = str(random.choice(numbers))
    shares = (0.0, -1.0, 1e-6, 1e6, 2.0, 0.5, 1.1, 10.0 ** random.uniform(-3, 3))
    constants[name] *= float(random.choice(shares))
    content.set_plan("constants", constants)
    return f"constant: {name} {constants[name]:g}"


def _uncertainty(content: Content, random: Random) -> str:
    stated = content.metadata["identify"].get("uncertainties")
    if stated is None:
        return _constant(content, random)
    sizes = json.loads(stated)
    name = str(random.choice(sorted(sizes)))
    sizes[name]["size"] = float(random.choice((0.0, 1e-9, 0.5, 10.0, 1e6)))
    content.set_plan("uncertainties", sizes)
    return f"uncertainty: {name} {sizes[name]['size']:g}"


def _missing_constant(content: Content, random: Random) -> str:
    constants = content.plan("constants")
    name = str(random.choice(sorted(constants)))
    del constants[name]
    content.set_plan("constants", constants)
    return f"constant not given: {name}"


def _swapped_signals(content: Content, random: Random) -> str:
    signals = content.plan("signals")
    first, second = random.choice(sorted(signals), 2, replace=False)
    signals[first], signals[second] = signals[second], signals[first]
    content.set_plan("signals", signals)
    return f"signals swapped: {first} and {second}"


def _trial_parameter(content: Content, random: Random) -> str:
    starts = [k for k, event in enumerate(content.events) if event.kind == "trial_start"]
    index = int(random.choice(starts))
    event = content.events[index]
    parameters = dict(event.data["parameters"])
    name = str(random.choice(sorted(parameters)))
    others: tuple[Any, ...] = (None, "x", 0.0, -1.0, 1e300, True, [])
    chosen = others[int(random.integers(len(others)))]
    data = {**event.data, "parameters": {**parameters, name: chosen}}
    content.events[index] = replace(event, data=data)
    return f"parameter of a trial: {name} {chosen!r}"


def _fewer_events(content: Content, random: Random) -> str:
    kinds = sorted({event.kind for event in content.events})
    kind = str(random.choice(kinds))
    content.events[:] = [e for e in content.events if e.kind != kind or random.random() < 0.5]
    return f"events lost: {kind}"


def _trial_copied(content: Content, random: Random) -> str:
    """Let the rows of one trial stand for those of another."""
    starts = [event.t_ns for event in content.events if event.kind == "trial_start"]
    first, second = (int(starts[k]) for k in random.integers(0, len(starts), 2))
    length_ns = 3_000_000_000
    for rows in content.rows.values():
        times = rows["t_ns"].astype(np.int64)
        source = (times >= first) & (times < first + length_ns)
        target = (times >= second) & (times < second + length_ns)
        count = min(int(source.sum()), int(target.sum()))
        kept = rows["t_ns"][target][:count].copy()
        rows[np.flatnonzero(target)[:count]] = rows[source][:count]
        rows["t_ns"][np.flatnonzero(target)[:count]] = kept
    return "a trial is a copy of another"


SPOILS: Final[Sequence[Spoil]] = (
    _values("not a number", lambda values, _: np.full_like(values, np.nan)),
    _values("infinite", lambda values, _: np.full_like(values, -np.inf)),
    _values("constant", lambda values, _: np.full_like(values, values[:1].sum())),
    _values("zero", lambda values, _: np.zeros_like(values)),
    _values("factor", lambda values, random: values * 10.0 ** random.uniform(-3, 3)),
    _values("sign", lambda values, _: -values),
    _values("offset", lambda values, random: values + 10.0 ** random.uniform(-3, 3)),
    _values("noise", lambda values, random: values
            + 10.0 ** random.uniform(-4, 2) * random.standard_normal(len(values))),
    _values("random walk", lambda values, random: values
            + 10.0 ** random.uniform(-5, 0) * random.standard_normal(len(values)).cumsum()),
    _values("spikes", _spikes),
    _values("jump", _jump),
    _values("shuffled", lambda values, random: random.permutation(values)),
    _values("reversed", lambda values, _: values[::-1]),
    _values("held", lambda values, random: values[
        np.arange(len(values)) // (k := int(random.integers(2, 500))) * k]),
    _values("late", lambda values, random: np.roll(values, int(random.integers(1, 2000)))),
    _values("huge", lambda values, _: values + 1e300),
    _times("clock shifted", lambda times, random: np.maximum(
        times + int(10.0 ** random.uniform(3, 10) * random.choice((-1, 1))), 0)),
    _times("clock stopped", lambda times, _: np.full_like(times, times[0] if len(times) else 0)),
    _times("clock jitters", lambda times, random: np.maximum(
        times + random.integers(-2_000_000, 2_000_000, len(times)), 0)),
    _times("clock drifts", lambda times, random: (times[:1].sum()
        + (times - times[:1].sum()) * random.uniform(0.5, 2.0)).astype(np.int64)),
    _rows("rows lost", lambda rows, random: rows[random.random(len(rows)) > random.uniform(0, 1)]),
    _rows("end lost", lambda rows, random: rows[: int(random.integers(0, len(rows)))]),
    _rows("beginning lost", lambda rows, random: rows[int(random.integers(0, len(rows))) :]),
    _rows("one row", lambda rows, _: rows[:1]),
    _rows("empty", lambda rows, _: rows[:0]),
    _constant,
    _constant,
    _uncertainty,
    _missing_constant,
    _swapped_signals,
    _trial_parameter,
    _fewer_events,
    _trial_copied,
)  # fmt: skip


def spoilt(content: Content, random: Random) -> tuple[Content, str]:
    """Return a copy that is spoilt in one to three ways, and in which."""
    copy = content.copy()
    ways = [SPOILS[int(k)] for k in random.integers(0, len(SPOILS), int(random.integers(1, 4)))]
    return copy, "; ".join(way(copy, random) for way in ways)


def ending(path: Path, options: Options) -> str:
    """Return how the identification of ``path`` ends: with a result, or with which refusal."""
    try:
        evaluation = evaluate([path], options)
        json.dumps(evaluation.to_json(), allow_nan=False)
        evaluation.report()
        evaluation.terminal_report()
    except RigdError as error:
        return type(error).__name__
    return "a result" if evaluation.fits else "a misfit, without numbers"


def constants_of(content: Content) -> Mapping[str, float]:
    """Return the constants of the plan, in SI."""
    constants: Mapping[str, float] = content.plan("constants")
    return constants
