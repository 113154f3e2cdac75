"""Viewers come and go while another process fills the rings as fast as it can."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from support.daemon.live import PATIENCE_S, START_NS, prepared, writer
from support.daemon.ring_writer import STEP_NS, numbered

from rigd.engine.shared import EventView, RowRing, View
from rigd.model import Channel, Stream

STREAM = Stream("s", tuple(Channel(f"c{index}") for index in range(8)), has_status=True)
#: So small that the writer comes round many times while one copy is made.
CAPACITY = 64
#: So many rows must have been seen and as many missed: only then was it a race.
LEAST_ROWS = 1000


@pytest.mark.parametrize("block", [0, 16])
def test_no_viewer_ever_sees_a_torn_row(tmp_path: Path, block: int) -> None:
    folder = prepared(tmp_path / "run", [STREAM], CAPACITY)
    job, seen, skipped = folder.job, 0, 0
    with writer(folder, block=block):
        give_up_s = time.monotonic() + PATIENCE_S
        while min(seen, skipped) < LEAST_ROWS:
            assert time.monotonic() < give_up_s, (seen, skipped)
            view = View(folder.row_rings(job)["s"])
            last = -1
            for _ in range(200):
                rows = view.read()
                numbers = (rows["t_ns"] - START_NS) // STEP_NS
                if not len(rows):
                    continue
                whole = numbered(STREAM, START_NS, int(numbers[0]), len(rows))
                assert rows.tobytes() == whole.tobytes()
                assert numbers[0] > last
                seen, last = seen + len(rows), int(numbers[-1])
            skipped += view.skipped


def test_no_viewer_ever_sees_a_torn_event(tmp_path: Path) -> None:
    folder = prepared(tmp_path / "run", [STREAM], CAPACITY)
    seen, late = 0, 0
    with writer(folder):
        give_up_s = time.monotonic() + PATIENCE_S
        while min(seen, late) < LEAST_ROWS:
            assert time.monotonic() < give_up_s, (seen, late)
            view = EventView(folder.event_ring("cycle"))
            last = -1
            for _ in range(50):
                for event in view.read():
                    number = event.data["number"]
                    assert (event.kind, event.t_ns) == ("mark", number)
                    assert event.data["pad"] == "x" * (number % 97)
                    assert number > last
                    seen, last = seen + 1, number
            late += view.skipped


def test_view_of_a_removed_ring_sees_its_end(tmp_path: Path) -> None:
    folder = prepared(tmp_path / "run", [STREAM], CAPACITY)
    ring = folder.row_rings(folder.job)["s"]
    view = View(RowRing.attach(ring.path, STREAM))
    ring.push_block(numbered(STREAM, START_NS, 0, 5))
    folder.clear()
    assert view.read()["c0"].tolist() == np.arange(5).tolist()
