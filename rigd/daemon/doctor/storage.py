"""Checks the disk for the recordings and the memory for the rings (buffers of rows)."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rigd.daemon.doctor.check import Check, CheckVerdict
from rigd.engine.shared import state_folder
from rigd.model.errors import RigdError

_GROUP: Final = "machine"
#: Written to see how fast the disk is: as the recorder writes, a piece and then fdatasync.
_PIECE: Final = 1 << 18
_PIECES: Final = 48
#: Free disk for a rig that is not known: below the first it is not fit, below the second it warns.
_LEAST_FREE: Final = 50_000_000
_FREE_ENOUGH: Final = 5_000_000_000
#: A recording of so many hours should fit.
_HOURS: Final = 8.0
#: The disk should be so many times faster than the samples come.
_RESERVE: Final = 3.0
#: While the disk stands still, rings hold the rows of a minute; a run ends if they are 80 % full.
_LONG_SYNC_S: Final = 5.0
#: Memory for the rings if no rig is given: 20 streams at 1 kHz for a minute.
_SOME_RINGS: Final = 100_000_000


@dataclass(frozen=True)
class StorageNeeds:
    """The bytes per second that a rig writes (uncompressed), and the size of its rings in bytes."""

    bytes_per_s: float
    ring_bytes: int


def examine_storage(runs: Path, needs: StorageNeeds | None) -> Iterator[Check]:
    """Yield checks of the folder of recordings and of the state folder."""
    yield from _disk(runs, needs)
    yield _state(needs)


def _disk(runs: Path, needs: StorageNeeds | None) -> Iterator[Check]:
    folder = runs.absolute()
    while not folder.is_dir():
        folder = folder.parent
    free = shutil.disk_usage(folder).free
    found = f"{_size(free)} free at {runs}"
    figures: dict[str, object] = {"free_bytes": free}
    hours = None if needs is None else free / needs.bytes_per_s / 3600
    if hours is not None:
        found += f": {hours:.3g} h of this rig, uncompressed"
        figures["hours"] = hours
    verdict, advice = CheckVerdict.OK, ""
    if free < _LEAST_FREE:
        verdict, advice = CheckVerdict.FAIL, "make room: a run does not start"
    elif hours is not None and hours < _HOURS:
        verdict, advice = CheckVerdict.WARN, f"make room for a day of work ({_HOURS:g} h)"
    elif hours is None and free < _FREE_ENOUGH:
        verdict, advice = CheckVerdict.WARN, "make room: a rig at 1 kHz writes about 5 GB in 8 h"
    yield Check(_GROUP, "disk", verdict, found, advice, figures)
    if verdict is not CheckVerdict.FAIL:
        yield _speed(folder, needs)


def _speed(folder: Path, needs: StorageNeeds | None) -> Check:
    try:
        rate, longest_s = _write(folder)
    except OSError as error:
        advice = "give rigd a folder it may write to, with --runs"
        return Check(_GROUP, "disk speed", CheckVerdict.FAIL, f"{folder}: {error.strerror}", advice)
    found = f"{rate / 1e6:.3g} MB/s with fdatasync, the longest took {longest_s * 1e3:.3g} ms"
    figures = {"bytes_per_s": rate, "longest_sync_s": longest_s}
    name = "disk speed"
    if needs is not None and rate < needs.bytes_per_s:
        advice = (
            f"this rig gives {needs.bytes_per_s / 1e6:.3g} MB/s: record to a faster disk, or "
            "record fewer streams"
        )
        return Check(_GROUP, name, CheckVerdict.FAIL, found, advice, figures)
    if needs is not None and rate < _RESERVE * needs.bytes_per_s:
        advice = f"this rig gives {needs.bytes_per_s / 1e6:.3g} MB/s, which leaves little reserve"
        return Check(_GROUP, name, CheckVerdict.WARN, found, advice, figures)
    if longest_s > _LONG_SYNC_S:
        advice = "a disk that stands still for a minute ends a run: record to another one"
        return Check(_GROUP, name, CheckVerdict.WARN, found, advice, figures)
    return Check(_GROUP, name, CheckVerdict.OK, found, figures=figures)


def _write(folder: Path) -> tuple[float, float]:
    """Return the bytes per second written to disk, and the longest time of one piece, in s."""
    piece = os.urandom(_PIECE)  # random data, which a file system cannot compress
    longest_s = 0.0
    with tempfile.TemporaryFile(dir=folder) as file:
        begun = time.monotonic()
        for _ in range(_PIECES):
            before = time.monotonic()
            file.write(piece)
            file.flush()
            os.fdatasync(file.fileno())
            longest_s = max(longest_s, time.monotonic() - before)
        took_s = time.monotonic() - begun
    return _PIECE * _PIECES / took_s, longest_s


def _state(needs: StorageNeeds | None) -> Check:
    name = "ring memory"
    try:
        folder = state_folder()
    except RigdError as error:
        return Check(_GROUP, name, CheckVerdict.FAIL, error.message, error.hint or "")
    kind, free = _file_system(folder), shutil.disk_usage(folder).free
    wanted = _SOME_RINGS if needs is None else needs.ring_bytes
    found = f"{folder} on {kind}, {_size(free)} free, {_size(wanted)} needed"
    figures = {"file_system": kind, "free_bytes": free, "needed_bytes": wanted}
    if free < wanted:
        advice = "set RIGD_STATE to a private folder in memory (tmpfs) with more room"
        return Check(_GROUP, name, CheckVerdict.FAIL, found, advice, figures)
    if kind not in ("tmpfs", "ramfs"):
        advice = "set RIGD_STATE to a private folder in memory (tmpfs): a disk can stall the cycle"
        return Check(_GROUP, name, CheckVerdict.WARN, found, advice, figures)
    return Check(_GROUP, name, CheckVerdict.OK, found, figures=figures)


def _size(count: int) -> str:
    return f"{count / 1e9:.3g} GB" if count >= 1e9 else f"{count / 1e6:.3g} MB"


def _file_system(folder: Path) -> str:
    """Return the type of the file system that ``folder`` is on (proc_pid_mountinfo(5))."""
    longest, kind = -1, "an unknown file system"
    path = str(folder.resolve())
    for line in Path("/proc/self/mountinfo").read_text().splitlines():
        fields, _, tail = line.partition(" - ")
        point = fields.split()[4].encode().decode("unicode_escape")  # a blank is written \040
        inside = path == point or path.startswith(point.rstrip("/") + "/")
        if inside and len(point) >= longest:  # the last mounted lies on top
            longest, kind = len(point), tail.split()[0]
    return kind
