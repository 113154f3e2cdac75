"""Events keep any data they were given, and outlive damage behind them."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from rigd.model import RecordingError, Stream
from rigd.record import Event, Recording, RecordingWriter, recover
from rigd.record.write.openchunk import EVENTS_SPAN_NS, MIN_BYTES

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]

ODD: list[tuple[str, dict[str, Any], dict[str, Any]]] = [
    ("", {}, {}),
    ("prompt", {"text": "Gewicht 2,5 kg auflegen — µ σ 日本 🎚"}, {}),
    ("answer", {"zero": "a\x00b", "lines": 'one\n"two"\\'}, {}),
    ("fault", {"deep": {"list": [[1, [2.5, None, True]]]}}, {}),
    ("über", {"nan": [math.nan, math.inf, -math.inf]}, {"nan": ["nan", "inf", "-inf"]}),
    (
        "numpy",
        {"array": np.eye(2), "one": np.float32(0.5)},
        {"array": [[1, 0], [0, 1]], "one": 0.5},
    ),
    ("huge", {"table": "x" * 3_000_000}, {}),
    ("big", {"integer": 2**80, "small": 5e-324}, {}),
]


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_odd_events_come_back(
    create: Create, tmp_path: Path, start_ns: int, compression: str
) -> None:
    with create(compression=compression) as writer:
        for number, (kind, data, _) in enumerate(ODD):
            writer.event(start_ns + number, kind, number, data)
    expected = [
        Event(start_ns + number, kind, number, read or data)
        for number, (kind, data, read) in enumerate(ODD)
    ]
    assert Recording.open(tmp_path / "run.mcap").events() == expected
    with (tmp_path / "run.mcap").open("rb") as file:
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) == len(ODD)
    typestore = get_typestore(Stores.EMPTY)
    with AnyReader([tmp_path / "run.mcap"], default_typestore=typestore) as reader:
        decoded: list[Any] = [
            reader.deserialize(raw, connection.msgtype) for connection, _, raw in reader.messages()
        ]
    assert [(item.kind, item.trial) for item in decoded] == [(e.kind, e.trial) for e in expected]
    assert [json.loads(item.data) for item in decoded] == [event.data for event in expected]


def test_times_before_1970_are_refused_without_trace(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path, start_ns: int
) -> None:
    early = rows(servo, 3)
    early["t_ns"][0] = -5
    with create() as writer:
        writer.event(start_ns, "run_start")
        writer.write("wheel_servo", rows(servo, 2))
        with pytest.raises(RecordingError, match="'events' has the time -1 ns"):
            writer.event(-1, "step")
        with pytest.raises(RecordingError, match="'wheel_servo' has the time -5 ns"):
            writer.write("wheel_servo", early)
    recording = Recording.open(tmp_path / "run.mcap")
    assert len(recording.events()) == 1
    assert recording.count("wheel_servo") == 2


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_torn_file_keeps_events_before_damage(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path, start_ns: int, share: float
) -> None:
    """Events are sealed every 10 s of data, and do not all stand behind all of the samples."""
    trials, trial_ns = 30, 5_000_000_000
    given = rows(servo, trials * 500, rate_hz=100.0)
    with create() as writer:
        writer.event(start_ns, "run_start")
        for trial in range(trials):
            part = given[trial * 500 : (trial + 1) * 500]
            writer.event(int(part["t_ns"][0]), "trial_start", trial)
            writer.write("wheel_servo", part)
            writer.event(int(part["t_ns"][-1]), "trial_end", trial, {"complete": True})
    path = tmp_path / "run.mcap"
    os.truncate(path, int(path.stat().st_size * share))
    recover(path)
    recording = Recording.open(path)
    kept, info = recording.read("wheel_servo"), recording.info
    assert kept.tobytes() == given[: len(kept)].tobytes()
    assert (info.state, info.recovered) == ("interrupted", True)
    known_ns = recording.events()[-1].t_ns
    assert int(kept["t_ns"][-1]) - known_ns <= EVENTS_SPAN_NS + 2 * trial_ns
    assert info.trials_done >= (known_ns - start_ns) // trial_ns > 0


def test_many_events_at_once_are_sealed_by_size(
    create: Create, tmp_path: Path, start_ns: int
) -> None:
    with create() as writer:
        for number in range(1_000):
            writer.event(start_ns + number, "interlock", data={"name": "x" * 100})
    recording = Recording.open(tmp_path / "run.mcap")
    assert [event.t_ns - start_ns for event in recording.events()] == list(range(1_000))
    sizes = [chunk.uncompressed_size for chunk in recording.contents.chunks]
    assert len(sizes) > 3
    assert max(sizes) < MIN_BYTES + 1_000
