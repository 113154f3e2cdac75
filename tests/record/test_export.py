"""Tables for other programs hold the same numbers, with units and the trial of each row."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
import scipy.io
from numpy.typing import NDArray

from rigd.model import Channel, RecordingError, Stream
from rigd.record import Recording, RecordingWriter
from rigd.record.export import Format, export

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]
FIELDS = ("current", "speed", "counts", "status")


@pytest.fixture
def given(
    create: Create, rows: MakeRows, servo: Stream, force: Stream, start_ns: int
) -> NDArray[np.void]:
    """Rows of a recording run.mcap with one trial from 0.5 s to 1 s."""
    moved = rows(servo, 1_500)
    moved["current"][3] = math.nan
    moved["speed"][4] = math.inf
    with create() as writer:
        writer.write("wheel_servo", moved)
        writer.write("force", rows(force, 10))
        writer.event(start_ns + 500_000_000, "trial_start", 7, {"note": 'a "quoted", µ'})
        writer.event(start_ns + 1_000_000_000, "trial_end", 7, {"complete": True})
    return moved


def check_columns(columns: dict[str, NDArray[np.float64]], given: NDArray[np.void]) -> None:
    np.testing.assert_array_equal(columns["t_ns"], given["t_ns"])
    for field in FIELDS:
        np.testing.assert_array_equal(columns[field], given[field])
    assert columns["time"][1] == pytest.approx(1e-3)
    expected = np.full(1_500, -1)
    expected[500:1_000] = 7
    np.testing.assert_array_equal(columns["trial"], expected)


def test_parquet(given: NDArray[np.void], tmp_path: Path) -> None:
    paths = export(Recording.open(tmp_path / "run.mcap"), tmp_path / "out", "parquet")
    assert [path.name for path in paths] == [
        "wheel_servo.parquet",
        "force.parquet",
        "events.parquet",
        "trials.parquet",
    ]
    table = pyarrow.parquet.read_table(paths[0])
    check_columns({name: table[name].to_numpy() for name in table.column_names}, given)
    assert table["current"].null_count == 0
    assert table.field("current").metadata[b"unit"] == b"A"
    assert json.loads(table.schema.metadata[b"rigd.run"])["procedure"] == "sweep"
    events = pyarrow.parquet.read_table(paths[2]).to_pylist()
    assert [event["kind"] for event in events] == ["trial_start", "trial_end"]
    assert json.loads(events[0]["data"]) == {"note": 'a "quoted", µ'}


def test_csv(given: NDArray[np.void], tmp_path: Path) -> None:
    paths = export(Recording.open(tmp_path / "run.mcap"), tmp_path / "out", "csv")
    table = pyarrow.csv.read_csv(paths[0])
    assert table.column_names[:6] == [
        "t_ns [ns]",
        "time [s]",
        "trial",
        "trial_time [s]",
        "step",
        "current [A]",
    ]
    columns = {
        name.split(" ")[0]: table[name].to_numpy(zero_copy_only=False)
        for name in table.column_names
    }
    check_columns(columns, given)


def test_mat(given: NDArray[np.void], tmp_path: Path) -> None:
    paths = export(Recording.open(tmp_path / "run.mcap"), tmp_path / "out", "mat")
    content = scipy.io.loadmat(paths[0], squeeze_me=True, simplify_cells=True)
    check_columns(content, given)
    assert content["units"]["speed"] == "rad/s"
    events = scipy.io.loadmat(paths[2], squeeze_me=True, simplify_cells=True)
    assert list(events["kind"]) == ["trial_start", "trial_end"]


@pytest.mark.parametrize("format", ["parquet", "csv", "mat"])
def test_streams_are_exported_one_by_one(
    given: NDArray[np.void], create: Create, start_ns: int, tmp_path: Path, format: Format
) -> None:
    recording, out = Recording.open(tmp_path / "run.mcap"), tmp_path / "out"
    export(recording, out, format, streams=["force"])
    export(recording, out, format, streams=["wheel_servo"])
    with create("other.mcap") as writer:
        writer.event(start_ns, "trial_start", 8)
    before = (out / f"trials.{format}").read_bytes()
    with pytest.raises(RecordingError, match=rf"trials\.{format} exists already"):
        export(Recording.open(tmp_path / "other.mcap"), out, format, streams=["events"])
    assert (out / f"trials.{format}").read_bytes() == before


@pytest.mark.parametrize("format", ["parquet", "csv", "mat"])
def test_nothing_is_overwritten_unasked(
    given: NDArray[np.void], tmp_path: Path, format: Format
) -> None:
    recording, out = Recording.open(tmp_path / "run.mcap"), tmp_path / "out"
    out.mkdir()
    kept = out / f"force.{format}"
    kept.write_text("mine")
    with pytest.raises(RecordingError, match="exists already"):
        export(recording, out, format)
    assert [path.name for path in out.iterdir()] == [kept.name]
    assert kept.read_text() == "mine"
    assert len(export(recording, out, format, overwrite=True)) == 4
    assert kept.read_bytes() != b"mine"
    assert len(list(out.iterdir())) == 4


def test_one_stream_may_be_chosen(given: NDArray[np.void], tmp_path: Path) -> None:
    recording = Recording.open(tmp_path / "run.mcap")
    paths = export(recording, tmp_path / "out", "csv", streams=["force"])
    assert [path.name for path in paths] == ["force.csv", "trials.csv"]
    with pytest.raises(RecordingError, match="no stream 'forces'"):
        export(recording, tmp_path / "out", "csv", streams=["forces"])


def test_a_channel_named_time_keeps_its_name(
    create: Create, rows: MakeRows, tmp_path: Path
) -> None:
    clock = Stream("clock", (Channel("time", "s"),))
    moved = rows(clock, 3)
    with create(streams=(clock,)) as writer:
        writer.write("clock", moved)
    path, _ = export(Recording.open(tmp_path / "run.mcap"), tmp_path, "parquet", streams=["clock"])
    table = pyarrow.parquet.read_table(path)
    assert table.column_names == ["t_ns", "rigd_time", "trial", "trial_time", "step", "time"]
    np.testing.assert_array_equal(table["time"].to_numpy(), moved["time"])
