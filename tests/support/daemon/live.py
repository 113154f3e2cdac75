"""A run's folder with rings that a process of its own fills, and an outlet that keeps all."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from rigd.config.rig import RigConfig
from rigd.engine.cycle.wiring import streams_of
from rigd.engine.shared import Job, RunFolder, Word
from rigd.model import Stream
from rigd.remote.protocol import Frame, RigEvent, decode_frame

START_NS = 1_790_000_000_000_000_000
#: A crowded machine does what is waited for within this, in s.
PATIENCE_S = 60.0


@dataclass
class Kept:
    """Keeps every frame, decoded, and every event."""

    frames: dict[str, list[Frame]] = field(default_factory=dict)
    events: list[RigEvent] = field(default_factory=list)

    def frame(self, stream: str, payload: bytes) -> None:
        self.frames.setdefault(stream, []).append(decode_frame(payload))

    def event(self, event: RigEvent) -> None:
        self.events.append(event)


def prepared(path: Path, streams: Sequence[Stream], capacity: int) -> RunFolder:
    """Return a folder with empty rings, its clock started now at START_NS."""
    path.mkdir(parents=True, exist_ok=True)
    folder = RunFolder.at(path)
    job = Job("test", path / "none.mcap", tuple(streams), START_NS)
    folder.prepare(job, {stream.name: capacity for stream in streams})
    board = folder.board()
    board[Word.START_NS], board[Word.ORIGIN_NS] = START_NS, time.monotonic_ns()
    return folder


def folder_of(rig: RigConfig, path: Path, capacity: int = 10_000) -> RunFolder:
    """Return the folder of a run that records every stream of ``rig``."""
    return prepared(path, streams_of(rig), capacity)


@contextmanager
def writer(folder: RunFolder, rate_hz: float = 0.0, block: int = 0) -> Iterator[None]:
    """Fill the rings from another process (`ring_writer`) as long as this lasts."""
    script = Path(__file__).with_name("ring_writer.py")
    process = subprocess.Popen(
        [sys.executable, str(script), str(folder.path), str(rate_hz), str(block)]
    )
    try:
        until = time.monotonic() + PATIENCE_S
        while not folder.board()[Word.CYCLES]:
            assert process.poll() is None and time.monotonic() < until
            time.sleep(0.01)
        yield
    finally:
        process.terminate()
        assert process.wait(PATIENCE_S) == 0
