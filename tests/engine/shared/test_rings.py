"""Rings in shared memory: rows and events come out as they went in, and loss is counted."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from rigd.engine.shared import EventRing, EventView, RowRing, View
from rigd.model import Channel, RecordingError, Stream
from rigd.model.rows import row_dtype
from rigd.record.events.event import Event

STREAM = Stream("s", (Channel("a"), Channel("b", "A")), has_status=True)


def ring_of(tmp_path: Path, capacity: int) -> tuple[RowRing, RowRing]:
    """A ring as its writer and as its reader hold it."""
    writer = RowRing.create(tmp_path / "ring", STREAM, capacity)
    return writer, RowRing.attach(tmp_path / "ring", STREAM)


def test_rows_keep_order_and_values_across_the_wrap(tmp_path: Path) -> None:
    writer, reader = ring_of(tmp_path, 4)
    seen: list[object] = []
    for t in range(10):
        writer.push(t, (t + 0.5, -t, t % 3))
        if t % 3 == 2:
            seen += reader.drain().tolist()
    seen += reader.drain().tolist()
    assert seen == [(t, t + 0.5, -float(t), t % 3) for t in range(10)]
    assert reader.overruns == 0


def test_a_row_is_there_until_it_is_released(tmp_path: Path) -> None:
    writer, reader = ring_of(tmp_path, 3)
    for t in range(5):
        writer.push(t, (0.0, 0.0, 0))
    assert (reader.fill, reader.overruns) == (1.0, 2)
    assert reader.peek()["t_ns"].tolist() == [0, 1, 2]
    reader.release(2)
    # Another process that begins again finds what the first one left.
    writer, reader = RowRing.attach(writer.path, STREAM), RowRing.attach(writer.path, STREAM)
    writer.push(5, (0.0, 0.0, 0))
    assert reader.peek()["t_ns"].tolist() == [2, 5]
    assert (writer.head, writer.tail, writer.overruns) == (4, 2, 2)


def test_blocks_wrap_and_rows_beyond_room_are_counted(tmp_path: Path) -> None:
    writer, reader = ring_of(tmp_path, 10)
    rows = np.zeros(7, row_dtype(STREAM))
    rows["t_ns"] = range(7)
    writer.push_block(rows)
    assert reader.drain().tolist() == rows.tolist()
    writer.push_block(rows)
    writer.push_block(rows)
    assert reader.drain()["t_ns"].tolist() == [*range(7), 0, 1, 2]
    assert reader.overruns == 4


def test_view_delays_no_writer_and_counts_misses(tmp_path: Path) -> None:
    writer, reader = ring_of(tmp_path, 8)
    view = View(RowRing.attach(writer.path, STREAM))
    for t in range(5):
        writer.push(t, (float(t), 0.0, 0))
    assert view.read()["t_ns"].tolist() == [0, 1, 2, 3, 4]
    assert reader.latest(2)["t_ns"].tolist() == [3, 4]
    for t in range(5, 25):
        reader.drain()
        writer.push(t, (float(t), 0.0, 0))
    # The oldest of the ring is the one that the writer may be at: not to be trusted.
    assert view.read()["t_ns"].tolist() == list(range(18, 25))
    assert view.skipped == 13
    assert reader.latest(100)["t_ns"].tolist() == list(range(18, 25))
    assert len(view.read()) == 0


class Racing(RowRing):
    """A ring whose writer overtakes the reader in the middle of its copy."""

    def between(self, start: int, stop: int) -> np.ndarray[tuple[int], np.dtype[np.void]]:
        rows = super().between(start, stop)
        for t in range(stop, stop + 3):
            self.push(t, (0.0, 0.0, 0))
            self.release(1)
        return rows


def test_view_drops_what_was_overwritten_while_it_copied(tmp_path: Path) -> None:
    ring = Racing.create(tmp_path / "ring", STREAM, 8)
    view = View(ring)
    for t in range(8):
        ring.push(t, (0.0, 0.0, 0))
    ring.release(8)
    assert view.read()["t_ns"].tolist() == [4, 5, 6, 7]
    assert view.skipped == 4


def test_view_rejects_row_that_a_block_may_overwrite(tmp_path: Path) -> None:
    ring = RowRing.create(tmp_path / "ring", STREAM, 8)
    rows = np.zeros(3, row_dtype(STREAM))
    ring.push_block(rows)
    ring.release(3)
    ring.push_block(np.zeros(5, row_dtype(STREAM)))
    assert ring.claimed == 9  # all is announced; the next single row may be under way
    view = View(ring)
    view.position = 0
    halted = HaltedInBlock.attach(ring.path, STREAM)
    halted.push_block(rows)
    assert (ring.head, ring.claimed) == (8, 11)
    assert len(view.read()) == 5
    assert view.skipped == 3


class HaltedInBlock(RowRing):
    """A ring whose writer is killed when the rows of a block stand in it, not yet announced."""

    def push_block(self, rows: np.ndarray[tuple[int], np.dtype[np.void]]) -> None:
        self._rows = None  # type: ignore[assignment]
        with pytest.raises(TypeError):
            super().push_block(rows)


def test_a_ring_of_other_columns_is_refused(tmp_path: Path) -> None:
    ring, _ = ring_of(tmp_path, 4)
    swapped = Stream("s", tuple(reversed(STREAM.channels)), has_status=True)
    with pytest.raises(RecordingError, match="another layout"):
        RowRing.attach(ring.path, swapped)
    with pytest.raises(RecordingError, match="another layout"):
        EventRing.attach(ring.path)
    with pytest.raises(RecordingError, match="cannot make"):
        RowRing.create(ring.path, STREAM, 4)
    with pytest.raises(RecordingError, match="cannot open"):
        RowRing.attach(tmp_path / "none", STREAM)
    (tmp_path / "short").write_bytes(b"rigd")
    with pytest.raises(RecordingError, match="another layout"):
        RowRing.attach(tmp_path / "short", STREAM)


def test_events_keep_their_data_across_the_wrap(tmp_path: Path) -> None:
    writer = EventRing.create(tmp_path / "events", 300)
    reader = EventRing.attach(writer.path)
    for number in range(50):
        data = {"text": "µ" * (number % 40), "value": number / 3, "list": [1, None]}
        writer.push(number, f"kind{number}", number % 5 - 1, data)
        events = reader.peek()
        assert events == [Event(number, f"kind{number}", number % 5 - 1, data)]
        assert reader.released == number
        reader.release(1)
    assert (reader.released, reader.overruns, reader.fill) == (50, 0, 0.0)


def test_events_that_do_not_fit_are_counted(tmp_path: Path) -> None:
    writer = EventRing.create(tmp_path / "events", 200)
    for number in range(10):
        writer.push(number, "trip", -1, {})
    kept = len(writer.peek())
    assert 0 < kept < 10
    assert writer.overruns == 10 - kept
    writer.drain()
    writer.push(11, "long", -1, {"text": "x" * 300})
    assert writer.overruns == 11 - kept
    # The next process that attaches counts on.
    again = EventRing.attach(writer.path)
    again.push(12, "trip", -1, {"value": math.nan})
    assert again.drain() == [Event(12, "trip", -1, {"value": "nan"})]
    assert again.released == kept + 1


def test_event_view_blocks_no_writer_sees_remaining_events(tmp_path: Path) -> None:
    writer = EventRing.create(tmp_path / "events", 600)
    reader = EventRing.attach(writer.path)
    early = EventView(EventRing.attach(writer.path))
    told: list[Event] = []
    for number in range(50):
        writer.push(number, f"kind{number}", 0, {"text": "µ" * (number % 20)})
        reader.drain()  # released, and still to be seen until it is overwritten
        told += early.read() if number % 3 == 2 else []
    told += early.read()
    assert [event.t_ns for event in told] == list(range(50))
    assert early.skipped == 0
    late = EventView(EventRing.attach(writer.path))
    assert late.read() == []  # the ring has come round: the begin of its oldest is not known
    writer.push(50, "last", 0, {})
    assert [event.t_ns for event in late.read()] == [50]
    assert late.skipped == 50


def test_event_view_attached_late_begins_with_first(tmp_path: Path) -> None:
    writer = EventRing.create(tmp_path / "events", 600)
    for number in range(3):
        writer.push(number, "trip", 0, {})
    writer.drain()
    assert [event.t_ns for event in EventView(writer).read()] == [0, 1, 2]


class RacingEvents(EventRing):
    """A ring whose writer overtakes a reader in the middle of its copy, once."""

    raced = False

    def bytes_at(self, at: int, size: int) -> bytes:
        copied = super().bytes_at(at, size)
        if size > 300 and not self.raced:
            self.raced = True
            for number in range(100, 120):
                self.drain()
                self.push(number, "later", 0, {})
        return copied


def test_event_view_drops_events_overwritten_during_copy(tmp_path: Path) -> None:
    ring = RacingEvents.create(tmp_path / "events", 600)
    view = EventView(ring)
    for number in range(10):
        ring.push(number, "early", 0, {"number": number})
    # Of those that came meanwhile, only the last was not released.
    assert [event.t_ns for event in view.read()] == [119]
    assert view.skipped == 29


def test_event_without_json_form_is_refused(tmp_path: Path) -> None:
    ring = EventRing.create(tmp_path / "events", 1000)
    with pytest.raises(RecordingError, match="'odd' cannot be recorded"):
        ring.push(0, "odd", -1, {"what": object()})
    assert ring.peek() == []
