"""Opens a finished recording to append to it, after a check of every byte that stays."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rigd.model import RecordingError, Stream
from rigd.model.machine.system import BINARY
from rigd.record.events.trial_series import TrialSeries
from rigd.record.mcap.access import how_to_recover
from rigd.record.mcap.contents import Contents, SummaryWriter
from rigd.record.mcap.file import RecordingFile, lock, write_error
from rigd.record.mcap.schema import TRIAL_CHANNEL
from rigd.record.mcap.wire import map_file
from rigd.record.read.reader import Recording
from rigd.record.scan.scan import scan


@dataclass(frozen=True)
class Start:
    """A recording opened for appending: its file, index, and the channel number of each stream."""

    file: RecordingFile
    contents: Contents
    channels: dict[str, tuple[int, Stream]]
    start_ns: int
    numbers: dict[int, int]  #: of the next message, by channel: those that are lost had theirs
    trial: TrialSeries | None  #: as the events leave it; None if the file has no such topic


def open_for_append(path: Path, streams: Sequence[Stream], trusted: int = 0) -> Start:
    """Open a recording of exactly these streams; it stays locked until the file is closed.

    The first ``trusted`` bytes are not checked (:mod:`~rigd.record.scan.scan`).

    Raises:
        RecordingError: missing, torn, not written by rigd, being written, or other streams.

    """
    recording = Recording.open(path)
    _check_same(path, recording, streams)
    try:
        fd = os.open(path, os.O_RDWR | BINARY)
    except OSError as error:
        raise write_error(path, error) from error
    try:
        lock(fd, path)
        found = scan(map_file(fd), trusted)
        if not found.intact:
            raise RecordingError(
                f"{path} is damaged: {found.problem}",
                hint=how_to_recover(path),
            )
        file = RecordingFile.resume(
            fd, path, SummaryWriter(found.contents), found.data_end, found.data_crc
        )
    except BaseException:
        os.close(fd)
        raise
    by_topic = {channel.topic: number for number, channel in found.contents.channels.items()}
    channels = {stream.name: (by_topic[f"/{stream.name}"], stream) for stream in streams}
    numbers = dict(found.contents.counts)
    for gap in recording.gaps:
        number = by_topic.get(f"/{gap.stream}", 0)
        numbers[number] = numbers.get(number, 0) + (gap.rows or 0)
    trial = _trial(recording) if TRIAL_CHANNEL in found.contents.channels else None
    return Start(file, found.contents, channels, recording.start_ns, numbers, trial)


def _trial(recording: Recording) -> TrialSeries:
    series = TrialSeries()
    for event in recording.events():
        series.follow(event)
    return series


def _check_same(path: Path, recording: Recording, streams: Sequence[Stream]) -> None:
    if not recording.written_by_rigd:
        raise RecordingError(f"{path} was not written by rigd, which therefore does not add to it")
    known, given = recording.streams, {stream.name: stream for stream in streams}
    differing = sorted(
        name for name in known.keys() | given.keys() if known.get(name) != given.get(name)
    )
    if differing:
        raise RecordingError(
            f"{path} cannot be continued: stream {', '.join(differing)} differs from the rig's",
            hint="Resume with the rig file that the recording was begun with, or begin a new one.",
        )
