"""A process that fills rings: rows whose every value follows from their number.

    python ring_writer.py FOLDER RATE_HZ BLOCK

pushes rows into every ring of the run in FOLDER, one by one (BLOCK 0) or BLOCK at once, at RATE_HZ
(0: as fast as it can, releasing them at once), until SIGTERM; also events.
"""

from __future__ import annotations

import signal
import sys
import time
from pathlib import Path

import numpy as np

from rigd.engine.shared import RowRing, RunFolder, Word
from rigd.engine.sink import Rows
from rigd.model import Stream
from rigd.model.channels import STALE
from rigd.model.rows import row_dtype

#: Time between two rows in their time stamps.
STEP_NS = 1_000_000


def numbered(stream: Stream, start_ns: int, first: int, count: int) -> Rows:
    """Return rows ``first`` and following: channel j of row n holds n + j / 64."""
    rows = np.zeros(count, row_dtype(stream))
    numbers = np.arange(first, first + count)
    rows["t_ns"] = start_ns + numbers * STEP_NS
    for index, channel in enumerate(stream.channels):
        rows[channel.name] = numbers + index / 64
    if stream.has_status:
        rows["status"] = numbers & (STALE - 1)
    return rows


def _push(ring: RowRing, start_ns: int, first: int, count: int) -> None:
    if count:
        ring.push_block(numbered(ring.stream, start_ns, first, count))
        return
    row: list[float] = [first + index / 64 for index in range(len(ring.stream.channels))]
    if ring.stream.has_status:
        row.append(first & (STALE - 1))
    ring.push(start_ns + first * STEP_NS, row)


def main() -> None:
    folder, rate_hz, block = RunFolder.at(Path(sys.argv[1])), float(sys.argv[2]), int(sys.argv[3])
    job, board = folder.job, folder.board()
    rings = list(folder.row_rings(job).values())
    events = folder.event_ring("cycle")
    number, due = 0, time.monotonic()
    stop: list[bool] = []
    signal.signal(signal.SIGTERM, lambda *_: stop.append(True))
    while not stop:
        for ring in rings:
            _push(ring, job.start_ns, number, block)
            if not rate_hz:
                ring.release(ring.head - ring.tail)
        number += max(block, 1)
        if not rate_hz or number % 64 < max(block, 1):
            events.push(number, "mark", 0, {"number": number, "pad": "x" * (number % 97)})
            events.drain()
        board[Word.CYCLES] = number
        if rate_hz:
            due += max(block, 1) / rate_hz
            time.sleep(max(due - time.monotonic(), 0))


if __name__ == "__main__":
    main()
