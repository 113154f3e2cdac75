"""Refuses copies of recordings, under any name: the same samples twice are no new evidence."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence, Set
from hashlib import blake2b
from itertools import combinations
from pathlib import Path
from typing import Final

import numpy as np

from rigd.analysis.recordings.source import RecordedSweep
from rigd.analysis.result import FloatArray
from rigd.model.errors import DataError
from rigd.model.rows import TIME_FIELD
from rigd.record import Recording, TrialInfo

#: Trials that share so much of the shorter one, and differ nowhere, are one. A copy that lost a
#: part to a power cut shares the rest; two simulations with one seed rest alike and then differ.
SHARED: Final = 0.5
#: A channel shows noise if in so many of its steps, and in this share of them, it turns back, and
#: if it changes at this share of its samples: no sensor at rest, ramp or square wave does so.
TURNS: Final = 64
TURN_SHARE: Final = 1 / 3
STEP_SHARE: Final = 1 / 4
ROUNDING: Final = 1e-9  #: steps below this share of the largest value are no steps
COPY_HINT: Final = (
    "one is a copy of the other, or both were simulated with the same seed: give one of them"
)


def refuse_same_file(paths: Sequence[Path]) -> None:
    """Refuse a file that is given twice, by any path.

    Raises:
        DataError: it is.
    """
    seen: dict[Path, Path] = {}
    for path in paths:
        first = seen.get(file := path.resolve())
        if first is not None:
            text = f"{path} is given twice" if path == first else f"{path} and {first} are one file"
            raise DataError(text, hint="give it once: the same samples twice are no new evidence")
        seen[file] = path


def refuse_copies(sweeps: Sequence[RecordedSweep]) -> None:
    """Refuse recordings that hold a trial twice, judged by the signals of their plans.

    Raises:
        DataError: one is a copy of another, whole or in part, or an earlier state of it; or a trial
            is there twice in one.
        RecordingError: a recording is damaged.
    """
    channels = {channel for sweep in sweeps for channel in sweep.plan.signals.values()}
    refuse_same_trials([sweep.recording for sweep in sweeps], channels)


def refuse_same_trials(recordings: Sequence[Recording], channels: Collection[str]) -> None:
    """Refuse recordings that hold a trial twice: no two trials have the same noise.

    The streams of ``channels`` are compared.

    Raises:
        DataError: one is a copy of another, whole or in part, or an earlier state of it; or a trial
            is there twice in one.
        RecordingError: a recording is damaged.
    """
    streams = {channel.partition(".")[0] for channel in channels}
    for recording, other in combinations(recordings, 2):
        for first, second in _at_the_same_time(recording, other):
            if _alike(recording, first, other, second, streams):
                raise DataError(
                    f"trial {second.number} of {other.path} is sample for sample trial "
                    f"{first.number} of {recording.path}",
                    hint=COPY_HINT,
                )
    _refuse_same_noise(recordings, channels)


def _refuse_same_noise(recordings: Sequence[Recording], channels: Collection[str]) -> None:
    """Refuse a trial whose samples another one has, at whatever time, noise included.

    Raises:
        DataError: there is one.
        RecordingError: a recording is damaged.
    """
    seen: dict[bytes, tuple[Recording, TrialInfo]] = {}
    for recording in recordings:
        for digest, trial in _noisy_trials(recording, channels):
            other, first = seen.setdefault(digest, (recording, trial))
            if other is not recording:
                raise DataError(
                    f"trial {trial.number} of {recording.path} has the samples of trial "
                    f"{first.number} of {other.path}, at other times",
                    hint=COPY_HINT,
                )
            if first is not trial:
                raise DataError(
                    f"trials {first.number} and {trial.number} of {recording.path} have the same "
                    "samples, with their noise",
                    hint="one is a copy of the other: import or record it once",
                )


def _noisy_trials(
    recording: Recording, channels: Collection[str]
) -> Iterator[tuple[bytes, TrialInfo]]:
    """Yield a digest of all samples of each complete trial in which a channel shows noise.

    The times do not count: a table that is imported twice may begin at other ones. Trials without
    noise may be alike and yet be two: at rest, or simulated without noise.
    """
    wanted: dict[str, list[str]] = {}
    for stream, _, field in (channel.partition(".") for channel in sorted(channels)):
        if stream in recording.streams:
            wanted.setdefault(stream, []).append(field)
    for trial in (item.info for item in recording.trials if item.info.complete):
        digest, noisy = blake2b(digest_size=16), False
        for stream, fields in wanted.items():
            rows = recording.read(stream, trial.start_ns, trial.end_ns)
            for field in (name for name in fields if name in (rows.dtype.names or ())):
                noisy = noisy or _shows_noise(rows[field])
                digest.update(f"{stream}.{field} {len(rows)} ".encode())
                digest.update(rows[field].tobytes())
        if noisy:
            yield digest.digest(), trial


def _shows_noise(values: FloatArray) -> bool:
    """Return whether ``values`` (n,) go up and down so often as only noise makes them."""
    finite = values[np.isfinite(values)]
    largest = np.max(np.abs(finite), initial=0.0) or 1.0
    steps = np.diff(finite / largest)
    steps = steps[np.abs(steps) > ROUNDING]
    turns = int(np.count_nonzero(np.signbit(steps[1:]) != np.signbit(steps[:-1])))
    return turns >= max(TURNS, TURN_SHARE * len(steps)) and len(steps) >= STEP_SHARE * len(values)


def _at_the_same_time(
    recording: Recording, other: Recording
) -> Iterator[tuple[TrialInfo, TrialInfo]]:
    for first in recording.trials:
        for second in other.trials:
            if first.start_ns < _end_ns(second.info) and second.start_ns < _end_ns(first.info):
                yield first.info, second.info


def _end_ns(trial: TrialInfo) -> float:
    """Return when ``trial`` ended; one that a power cut ended is not over."""
    return math.inf if trial.end_ns is None else trial.end_ns


def _alike(
    recording: Recording,
    first: TrialInfo,
    other: Recording,
    second: TrialInfo,
    streams: Set[str],
) -> bool:
    """Whether all rows that both trials have at the same time are the same, and they are many."""
    shared = 0
    shorter = 0
    for name in sorted(recording.streams.keys() & other.streams.keys() & streams):
        rows = recording.read(name, first.start_ns, first.end_ns)
        others = other.read(name, second.start_ns, second.end_ns)
        if rows.dtype != others.dtype:
            return False
        at, other_at = rows[TIME_FIELD], others[TIME_FIELD]
        _, mine, theirs = np.intersect1d(at, other_at, assume_unique=True, return_indices=True)
        if rows[mine].tobytes() != others[theirs].tobytes():
            return False
        shared += len(mine)
        shorter += min(len(rows), len(others))
    return shared > SHARED * shorter
