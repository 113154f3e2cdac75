"""Refuses copies of recordings, under any name: the same samples twice are no new evidence."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence, Set
from itertools import combinations
from pathlib import Path
from typing import Final

import numpy as np

from rigd.analysis.source import RecordedSweep
from rigd.model.errors import DataError
from rigd.model.rows import TIME_FIELD
from rigd.record import Recording, TrialInfo

#: Trials that share so much of the shorter one, and differ nowhere, are one. A copy that lost a
#: part to a power cut shares the rest; two simulations with one seed rest alike and then differ.
SHARED: Final = 0.5


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
    """Refuse recordings that hold a trial in common, judged by the signals of their plans.

    Raises:
        DataError: one is a copy of another, whole or in part, or an earlier state of it.
        RecordingError: a recording is damaged.
    """
    channels = {channel for sweep in sweeps for channel in sweep.plan.signals.values()}
    refuse_same_trials([sweep.recording for sweep in sweeps], channels)


def refuse_same_trials(recordings: Sequence[Recording], channels: Collection[str]) -> None:
    """Refuse recordings that hold a trial in common: no two trials have the same noise.

    The streams of ``channels`` are compared.

    Raises:
        DataError: one is a copy of another, whole or in part, or an earlier state of it.
        RecordingError: a recording is damaged.
    """
    streams = {channel.partition(".")[0] for channel in channels}
    for recording, other in combinations(recordings, 2):
        for first, second in _at_the_same_time(recording, other):
            if _alike(recording, first, other, second, streams):
                raise DataError(
                    f"trial {second.number} of {other.path} is sample for sample trial "
                    f"{first.number} of {recording.path}",
                    hint="one is a copy of the other, or both were simulated with the same seed: "
                    "give one of them",
                )


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
        _, mine, theirs = np.intersect1d(
            rows[TIME_FIELD], others[TIME_FIELD], assume_unique=True, return_indices=True
        )
        if rows[mine].tobytes() != others[theirs].tobytes():
            return False
        shared += len(mine)
        shorter += min(len(rows), len(others))
    return shared > SHARED * shorter
