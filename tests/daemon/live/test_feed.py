"""The feed: frames and events of runs that come and go, and what a late client gets."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.daemon.live import PATIENCE_S, START_NS, Kept, folder_of, prepared, writer
from support.daemon.ring_writer import STEP_NS, numbered

from rigd.config.loader import load_rig
from rigd.daemon.live import Feed
from rigd.daemon.serve.describe import describe
from rigd.engine.cycle.wiring import streams_of
from rigd.engine.shared import RunFolder, Word
from rigd.engine.sink import Rows
from rigd.model.channels import Channel, Stream
from rigd.model.errors import RecordingError
from rigd.model.rows import row_dtype
from rigd.remote.protocol import Refusal, Role, decode, decode_frame, encode

RIG = load_rig("lugre-1")
STREAMS = {stream.name: stream for stream in streams_of(RIG)}


def wait_for(condition: Callable[[], bool]) -> None:
    until = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.01)


def drawn(name: str, first: int, count: int, draw: np.random.Generator) -> Rows:
    rows = np.zeros(count, row_dtype(STREAMS[name]))
    rows["t_ns"] = START_NS + np.arange(first, first + count) * STEP_NS
    for channel in STREAMS[name].channels:
        rows[channel.name] = draw.normal(size=count)
    return rows


def test_frames_bound_every_sample_exactly(tmp_path: Path) -> None:
    folder, kept, draw = folder_of(RIG, tmp_path / "run"), Kept(), np.random.default_rng(1)
    rings = folder.row_rings(folder.job)
    feed = Feed(RIG, kept)
    feed.attach(folder)
    pushed: dict[str, list[Rows]] = {name: [] for name in STREAMS}
    first = 0
    for count in (1, 7, 33, 60, 61, 500, 0, 2, 1000):
        for name, ring in rings.items():
            rows = drawn(name, first, count, draw)
            ring.push_block(rows)
            pushed[name].append(rows)
        first += count
        feed.tick()
    for number, (name, stream) in enumerate(STREAMS.items()):
        rows, since, shown = np.concatenate(pushed[name]), -1, 0
        for sequence, frame in enumerate(kept.frames[name]):
            assert (frame.stream, frame.sequence) == (number, sequence)
            for point, time_s in enumerate(frame.time_s):
                time_ns = frame.t0_ns + round(time_s * 1e9)
                stands_for = rows[(rows["t_ns"] > since) & (rows["t_ns"] <= time_ns)]
                for index, channel in enumerate(stream.channels):
                    values = stands_for[channel.name]
                    assert frame.low[index, point] == np.float32(values.min())
                    assert frame.high[index, point] == np.float32(values.max())
                since, shown = time_ns, shown + len(stands_for)
        assert shown == len(rows)
    assert feed.skipped == 0


def test_thread_sends_rows_of_another_process(tmp_path: Path) -> None:
    folder, kept = folder_of(RIG, tmp_path / "run", 100_000), Kept()
    raw: dict[str, int] = {}

    def count(stream: Stream, rows: Rows) -> None:
        raw[stream.name] = raw.get(stream.name, 0) + len(rows)

    with Feed(RIG, kept, raw=count) as feed:
        with writer(folder, rate_hz=1000):
            rings = folder.row_rings(folder.job)
            before = {name: ring.head for name, ring in rings.items()}
            feed.attach(folder)
            after = {name: ring.head for name, ring in rings.items()}
            wait_for(lambda: len(kept.frames.get("cycle", [])) > 20)
        feed.detach()
        pushed = folder.board()[Word.CYCLES]
        for name in STREAMS:
            frames = kept.frames[name]
            assert frames[-1].low[0, -1] == pushed - 1
            assert [frame.sequence for frame in frames] == list(range(len(frames)))
            assert before[name] <= pushed - raw[name] <= after[name]
        latest = feed.latest()
        newest = latest.values["cycle.actual"]
        assert newest.value == pushed - 1 + 1 / 64
        # The writer's rows are stamped evenly, with any load of the machine.
        row_ns = START_NS + (pushed - 1) * STEP_NS
        assert newest.age_s == pytest.approx((latest.t_ns - row_ns) * 1e-9)
        assert [event.kind for event in kept.events[:2]] == ["mark", "mark"]


def test_events_of_both_rings_keep_order_from_first(tmp_path: Path) -> None:
    folder, kept = folder_of(RIG, tmp_path / "run"), Kept()
    cycle, daemon = folder.event_ring("cycle"), folder.event_ring("daemon")
    daemon.push(1, "run_start", -1, {})
    daemon.drain()  # recorded already, and still to be seen
    happened: list[str] = []
    feed = Feed(RIG, kept, happened=lambda event: happened.append(event.kind))
    feed.attach(folder)
    cycle.push(5, "trip", 3, {"value": float("nan")})
    daemon.push(4, "trial_start", 3, {})
    feed.tick()
    feed.publish("lease", {"holder": "alice"})
    daemon.push(9, "run_end", -1, {})
    folder.clear()  # as the recorder does at the end
    feed.detach()
    daemon.push(10, "never", -1, {})
    feed.tick()
    assert [event.kind for event in kept.events] == [
        "run_start", "trial_start", "trip", "lease", "run_end",
    ]  # fmt: skip
    assert happened == ["run_start", "trial_start", "trip", "run_end"]
    assert [event.seq for event in kept.events] == [0, 1, 2, 3, 4]
    assert kept.events[2].data == {"value": "nan"}
    assert feed.events(3) == (kept.events[3:], 5)
    assert feed.events(5) == ([], 5)
    feed.attach(folder_of(RIG, tmp_path / "next"))
    feed.tick()
    assert feed.events(0) == (kept.events, 5)


def test_run_without_a_stream_keeps_its_last_value(tmp_path: Path) -> None:
    folder, kept = folder_of(RIG, tmp_path / "run"), Kept()
    feed = Feed(RIG, kept)
    assert feed.latest().values == {}
    assert feed.history("cycle").frame is None
    feed.attach(folder)
    for name, ring in folder.row_rings(folder.job).items():
        ring.push_block(numbered(STREAMS[name], START_NS, 0, 10))
    feed.detach()
    feed.detach()
    values = feed.latest().values
    assert len(values) == sum(len(stream.channels) for stream in STREAMS.values())
    assert values["cycle.scheduled"].value == 9.0
    history = feed.history("cycle")
    assert history.frame is not None
    assert decode_frame(history.frame).low[0, -1] == 9.0
    assert decode(type(history), encode(history)) == history
    with pytest.raises(Refusal, match="known: wheel_servo"):
        feed.history("nothing")
    with pytest.raises(RecordingError):
        feed.attach(RunFolder.at(tmp_path / "empty"))


def test_value_that_is_not_a_number_becomes_none(tmp_path: Path) -> None:
    folder, feed = folder_of(RIG, tmp_path / "run"), Feed(RIG, Kept())
    feed.attach(folder)
    rows = numbered(STREAMS["cycle"], START_NS, 0, 1)
    rows["spent"], rows["stale"] = np.nan, np.inf
    folder.row_rings(folder.job)["cycle"].push_block(rows)
    feed.detach()
    values = feed.latest().values
    assert values["cycle.spent"].value is None and values["cycle.stale"].value is None
    assert values["cycle.actual"].value == 1 / 64


class Frozen(Kept):
    """Takes nothing more after the first frame of ``stream`` until it is let go."""

    def __init__(self, stream: str) -> None:
        super().__init__()
        self.stream = stream
        self.reached, self.go_on = threading.Event(), threading.Event()

    def frame(self, stream: str, payload: bytes) -> None:
        if stream == self.stream:
            self.reached.set()
            assert self.go_on.wait(PATIENCE_S)
        super().frame(stream, payload)


def test_frozen_consumer_blocks_no_writer_and_loses_frames(tmp_path: Path) -> None:
    folder, first = folder_of(RIG, tmp_path / "run", 100_000), next(iter(STREAMS))
    board, frozen = folder.board(), Frozen(first)
    with Feed(RIG, frozen) as feed, writer(folder, rate_hz=1000):
        feed.attach(folder)
        assert frozen.reached.wait(PATIENCE_S)
        since = board[Word.CYCLES]
        wait_for(lambda: board[Word.CYCLES] > since + 1000)
        frozen.go_on.set()
        wait_for(lambda: len(frozen.frames.get(first, [])) > 1)
        # A second in one frame, and nothing of it missing.
        assert feed.skipped == 0
        frames = frozen.frames[first]
        assert frames[1].low[0, 0] == frames[0].high[0, -1] + 1
        assert frames[1].high[0, -1] - frames[1].low[0, 0] > 900


class Broken(Kept):
    """Fails at first, on one stream."""

    failures = 3

    def frame(self, stream: str, payload: bytes) -> None:
        if self.failures and stream == next(iter(STREAMS)):
            self.failures -= 1
            raise OSError("the cable is out")
        super().frame(stream, payload)


def test_failure_to_show_is_logged_once_and_survived(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder, broken = folder_of(RIG, tmp_path / "run"), Broken()
    rings = folder.row_rings(folder.job)
    feed = Feed(RIG, broken)
    feed.attach(folder)
    with caplog.at_level(logging.ERROR):
        for number in range(5):
            for name, ring in rings.items():
                ring.push_block(numbered(STREAMS[name], START_NS, number, 1))
            folder.event_ring("cycle").push(number, "step", 0, {})
            feed.tick()
    first, *others = STREAMS  # it fails on the first stream only, and hides nothing else
    assert [frame.low[0, 0] for frame in broken.frames[first]] == [3, 4]
    for name in others:
        assert [frame.low[0, 0] for frame in broken.frames[name]] == [0, 1, 2, 3, 4]
    assert [event.t_ns for event in broken.events] == [0, 1, 2, 3, 4]
    assert len(caplog.records) == 1
    assert "the cable is out" in caplog.text


def test_stopping_twice_and_never_starting_are_silent() -> None:
    feed = Feed(RIG, Kept())
    feed.stop()
    with Feed(RIG, Kept()) as feed:
        feed.stop()


def test_stream_of_run_gets_a_new_number(tmp_path: Path) -> None:
    kept = Kept()
    feed = Feed(RIG, kept)
    numbers = []
    for run, names in enumerate((("force",), ("force", "power"), (), ("force",))):
        channels = tuple(Channel(name, "N", display="kN") for name in names)
        streams = [*streams_of(RIG), *([Stream("own", channels)] if channels else [])]
        feed.attach(prepared(tmp_path / str(run), streams, 100))
        numbers += [(live.number, len(live.stream.channels)) for live in feed.of_run]
    base = len(STREAMS)
    assert numbers == [(base, 1), (base + 1, 2), (base + 2, 1)]
    assert [event.data["added"] for event in kept.events] == [["own"], ["own"], [], ["own"]]
    described = describe(RIG, Role.OBSERVER, feed.of_run).streams[-1]
    assert (described.number, described.name, described.rate_hz) == (base + 2, "own", 1000)
    assert (described.channels[0].unit, described.channels[0].display) == ("N", "kN")
