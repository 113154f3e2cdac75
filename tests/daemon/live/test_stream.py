"""A stream as it is shown: frames, its newest row, its last ten seconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rigd.daemon.live.stream import FRAME_POINTS, HISTORY_POINTS, LiveStream
from rigd.engine.shared import RowRing
from rigd.engine.sink import Rows
from rigd.model import Channel, Stream
from rigd.model.channels import STALE
from rigd.model.rows import row_dtype
from rigd.remote.protocol import decode_frame, encode_frame

STREAM = Stream("s", (Channel("a"), Channel("b", "A")), has_status=True)
START_NS = 1_790_000_000_000_000_000


def rows(first: int, count: int, status: int = 3) -> Rows:
    made = np.zeros(count, row_dtype(STREAM))
    numbers = np.arange(first, first + count)
    made["t_ns"], made["status"] = START_NS + numbers * 1_000_000, status
    made["a"], made["b"] = numbers, np.sin(numbers)
    return made


def test_frame_has_the_values_of_its_rows(tmp_path: Path) -> None:
    ring = RowRing.create(tmp_path / "ring", STREAM, 1000)
    live = LiveStream(4, STREAM)
    assert live.read() is None
    live.attach(RowRing.attach(ring.path, STREAM))
    assert live.read() is None
    ring.push_block(rows(0, 33))
    came = live.read()
    assert came is not None
    frame = decode_frame(encode_frame(live.frame(came)))
    assert (frame.stream, frame.sequence, frame.t0_ns) == (4, 0, START_NS)
    assert np.round(frame.time_s * 1e3, 9).tolist() == list(range(33))
    assert frame.low[0].tolist() == frame.high[0].tolist() == list(range(33))
    assert frame.low[1].tolist() == np.sin(np.arange(33)).astype("f4").tolist()
    ring.push_block(rows(33, 900))
    came = live.read()
    assert came is not None
    frame = live.frame(came)
    assert (frame.sequence, len(frame.time_s)) == (1, FRAME_POINTS)
    assert (frame.low[0, 0], frame.high[0, -1]) == (33, 932)
    live.attach(None)
    assert live.read() is None
    assert live.newest() == (START_NS + 932_000_000, [932.0, np.sin(932)])


def test_rows_that_repeat_earlier_one_are_not_shown(tmp_path: Path) -> None:
    ring = RowRing.create(tmp_path / "ring", STREAM, 1000)
    live = LiveStream(0, STREAM)
    live.attach(ring)
    ring.push_block(rows(0, 5, STALE | 3))
    assert live.read() is None
    mixed = rows(5, 5)
    mixed["status"][::2] |= STALE
    ring.push_block(mixed)
    came = live.read()
    assert came is not None
    assert came["a"].tolist() == [6, 8]


def test_late_client_gets_the_last_ten_seconds(tmp_path: Path) -> None:
    live = LiveStream(0, STREAM)
    assert live.history() is None
    assert live.newest() is None
    for first in range(0, 30_000, 33):
        last = live.frame(rows(first, 33))
    history = live.history()
    assert history is not None
    assert history.sequence == last.sequence
    assert 300 < len(history.time_s) <= HISTORY_POINTS
    assert 9.9 <= history.time_s[-1] - history.time_s[0] <= 10.1
    assert history.low[0, -1] == 30_029
    assert np.all(np.diff(history.time_s) > 0)
    # It is long since, and still the last that is known.
    live.frame(rows(100_000, 1))
    assert live.history() is not None
    assert live.newest() == (START_NS + 100_000_000_000, [100_000.0, np.sin(100_000)])


def test_value_too_large_for_picture_becomes_infinite() -> None:
    made = rows(0, 1)
    made["a"], made["b"] = 1e300, np.nan
    frame = LiveStream(0, STREAM).frame(made)
    assert frame.low[0, 0] == np.inf
    assert np.isnan(frame.high[1, 0])


def test_history_has_one_time_after_clock_step() -> None:
    live = LiveStream(0, STREAM)
    for first in range(3_600_000, 3_620_000, 33):
        live.frame(rows(first, 33))
    for first in range(0, 20_000, 33):
        live.frame(rows(first, 33))
    history = live.history()
    assert history is not None
    assert 9.9 <= history.time_s[-1] - history.time_s[0] <= 10.1
    assert np.all(np.diff(history.time_s) > 0)
