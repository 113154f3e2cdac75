"""Checks a recording without changing it, and reports lost rows and trials."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from mcap.opcode import Opcode

from rigd.model import RecordingError
from rigd.record.events.gaps import Gap, gap_text, gaps_json
from rigd.record.events.trials import TrialInfo
from rigd.record.mcap.access import require_regular, share
from rigd.record.mcap.bounds import about
from rigd.record.mcap.contents import rows_by_topic
from rigd.record.mcap.file import RecordingInUse
from rigd.record.mcap.wire import Malformed, map_file
from rigd.record.read.condition import (
    FileCondition,
    Foreign,
    foreign_json,
    foreign_lines,
    writer_of,
)
from rigd.record.read.index import damaged
from rigd.record.read.messages.topics import Topic
from rigd.record.read.reader import Recording
from rigd.record.scan.scan import Damage, Scan, scan


@dataclass(frozen=True)
class Verification:
    """The result of a check. ``damages`` lists the bytes that are not valid.

    ``foreign`` is what is known of a file that another program wrote, ``topics`` are those that
    rigd does not read as columns. ``gaps`` are the rows that are lost, now or since an earlier
    repair; ``trials`` those that lost rows. ``rows`` are the intact rows by topic, ``chunks`` the
    number of intact chunks.
    """

    path: Path
    size: int
    start_ns: int
    damages: tuple[Damage, ...]
    gaps: tuple[Gap, ...]
    trials: tuple[TrialInfo, ...]
    rows: Mapping[str, int]
    chunks: int
    condition: FileCondition
    foreign: Foreign | None
    topics: tuple[Topic, ...]

    @property
    def sound(self) -> bool:
        """Whether every byte is as it was written."""
        return not self.damages

    @property
    def state(self) -> str:
        """What the file is, and what wrote it, in words."""
        return f"{self.condition}, written by {writer_of(self.foreign)}"

    def lines(self) -> list[str]:
        """Return the result as text, line by line."""
        lines = [f"damaged: {damage}" for damage in self.damages]
        lines += foreign_lines(self.foreign)
        lines += [f"not read as columns: {topic}" for topic in self.topics]
        lines += [f"lost: {gap_text(gap, self.start_ns)}" for gap in self.gaps]
        lines += [f"trial {trial.number} is not complete: {trial.lost}" for trial in self.trials]
        return lines


def verify(path: Path) -> Verification:
    """Check every byte of a recording; nothing is written.

    Raises:
        RecordingInUse: it is being written.
        RecordingError: missing, empty, or no MCAP file.

    """
    found, recording = _scan(path)
    return Verification(
        path=path,
        size=recording.size,
        start_ns=found.start_ns,
        damages=tuple(found.damages),
        gaps=recording.gaps,
        trials=tuple(trial.info for trial in recording.trials if trial.info.lost),
        rows=_rows(found),
        chunks=sum(piece.opcode == Opcode.CHUNK for piece in found.pieces),
        condition=recording.condition,
        foreign=recording.foreign,
        topics=tuple(recording.topics.others),
    )


def verification_json(found: Verification) -> dict[str, object]:
    """Return a verification as an object for ``json.dumps``."""
    return {
        "recording": str(found.path),
        "bytes": found.size,
        "file": found.condition,
        **foreign_json(found.foreign),
        "sound": found.sound,
        "chunks": found.chunks,
        "rows": dict(found.rows),
        "not_read": [asdict(topic) for topic in found.topics],
        "damages": [damage._asdict() for damage in found.damages],
        "lost_rows": gaps_json(found.gaps, found.start_ns),
        "trials": [{"number": trial.number, "lost": trial.lost} for trial in found.trials],
    }


def _rows(found: Scan) -> dict[str, int]:
    """Return the messages of each topic, each counted once."""
    rows = rows_by_topic(found.contents)
    return {topic: count - found.doubled.get(topic, 0) for topic, count in rows.items()}


def _scan(path: Path) -> tuple[Scan, Recording]:
    try:
        require_regular(path)
        with path.open("rb", buffering=0) as file, about(path):
            if not os.fstat(file.fileno()).st_size:
                raise RecordingError(f"{path} is empty", hint="Nothing was recorded.")
            if not share(file.fileno()):
                raise RecordingInUse(
                    f"{path} is being written", hint="Wait until its run has ended."
                )
            found = scan(map_file(file.fileno()))
            return found, Recording.of(file.fileno(), path, found)
    except Malformed as error:
        raise damaged(path, error) from error
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}") from error
