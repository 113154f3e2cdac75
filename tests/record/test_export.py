"""Tables for other programs hold the same numbers, with units and the trial of each row."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import asammdf
import h5py
import numpy as np
import pandas as pd
import pyarrow.csv
import pyarrow.parquet
import pytest
import scipy.io
from numpy.typing import NDArray

from rigd.cli.main import main
from rigd.model import Channel, RecordingError, Stream
from rigd.record import Recording, RecordingWriter
from rigd.record.export import Format, export
from rigd.record.read.joined_table import TimeBase, joined_table

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]
TABLES = ["wheel_servo", "force", "events", "trials", "steps"]
FIELDS = ("current", "speed", "counts", "status")


@pytest.fixture
def given(
    create: Create, rows: MakeRows, servo: Stream, force: Stream, start_ns: int
) -> NDArray[np.void]:
    """Rows of a recording run.mcap with one trial from 0.5 s to 1 s, its step from 0.6 s."""
    moved = rows(servo, 1_500)
    moved["current"][3] = math.nan
    moved["speed"][4] = math.inf
    with create() as writer:
        writer.write("wheel_servo", moved)
        writer.write("force", rows(force, 10))
        writer.event(start_ns + 500_000_000, "trial_start", 7, {"note": 'a "quoted", µ'})
        writer.event(start_ns + 600_000_000, "step", 7, {"name": "drive"})
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
    inside = expected == 7
    np.testing.assert_allclose(columns["trial_time"][inside], np.arange(500) * 1e-3, atol=1e-9)
    assert np.isnan(columns["trial_time"][~inside]).all()


def test_parquet_export_has_columns_and_events(given: NDArray[np.void], tmp_path: Path) -> None:
    paths = export(Recording.open(tmp_path / "run.mcap"), tmp_path / "out", "parquet")
    assert [path.name for path in paths] == [
        "wheel_servo.parquet",
        "force.parquet",
        "events.parquet",
        "trials.parquet",
        "steps.parquet",
    ]
    table = pyarrow.parquet.read_table(paths[0])
    check_columns({name: table[name].to_numpy() for name in table.column_names}, given)
    assert table["step"].to_pylist()[599:601] == ["", "drive"]
    assert table["current"].null_count == 0
    assert table.field("current").metadata[b"unit"] == b"A"
    assert json.loads(table.schema.metadata[b"rigd.run"])["procedure"] == "sweep"
    events = pyarrow.parquet.read_table(paths[2]).to_pylist()
    assert [event["kind"] for event in events] == ["trial_start", "step", "trial_end"]
    assert json.loads(events[0]["data"]) == {"note": 'a "quoted", µ'}


def test_csv_export_has_columns_and_events(given: NDArray[np.void], tmp_path: Path) -> None:
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
    assert list(columns["step"][599:601]) == ["", "drive"]


def test_mat_export_has_columns_units_and_events(given: NDArray[np.void], tmp_path: Path) -> None:
    paths = export(Recording.open(tmp_path / "run.mcap"), tmp_path / "out", "mat")
    content = scipy.io.loadmat(paths[0], squeeze_me=True, simplify_cells=True)
    check_columns(content, given)
    assert (list(content["step"][599:601]), content["step_names"]) == ([0, 1], "drive")
    assert content["units"]["speed"] == "rad/s"
    events = scipy.io.loadmat(paths[2], squeeze_me=True, simplify_cells=True)
    assert list(events["kind"]) == ["trial_start", "step", "trial_end"]


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
def test_existing_files_are_not_overwritten(
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
    written = export(recording, out, format, overwrite=True)
    assert [path.stem for path in written[:5]] == TABLES
    assert kept.read_bytes() != b"mine"
    assert sorted(out.iterdir()) == sorted(written)


def test_one_stream_may_be_chosen(given: NDArray[np.void], tmp_path: Path) -> None:
    recording = Recording.open(tmp_path / "run.mcap")
    paths = export(recording, tmp_path / "out", "csv", streams=["force"])
    names = ["force.csv", "trials.csv", "steps.csv", "metadata.json"]
    assert [path.name for path in paths] == names
    beside = json.loads(paths[-1].read_text("utf-8"))
    assert beside["streams"]["wheel_servo"]["channels"]["current"] == {
        "unit": "A", "description": "motor current",
    }  # fmt: skip
    assert beside["metadata"]["run"]["procedure"] == "sweep"
    with pytest.raises(RecordingError, match="no stream 'forces'") as refused:
        export(recording, tmp_path / "out", "csv", streams=["forces"])
    assert refused.value.hint == "did you mean 'force'?"


def test_a_channel_named_time_keeps_its_name(
    create: Create, rows: MakeRows, tmp_path: Path
) -> None:
    clock = Stream("clock", (Channel("time", "s"),))
    moved = rows(clock, 3)
    with create(streams=(clock,)) as writer:
        writer.write("clock", moved)
    path, *_ = export(Recording.open(tmp_path / "run.mcap"), tmp_path, "parquet", streams=["clock"])
    table = pyarrow.parquet.read_table(path)
    assert table.column_names == ["t_ns", "rigd_time", "trial", "trial_time", "step", "time"]
    np.testing.assert_array_equal(table["time"].to_numpy(), moved["time"])


@pytest.fixture
def several_rates(create: Create, rows: MakeRows, servo: Stream, force: Stream) -> Recording:
    """1 kHz and 10 Hz; the slow stream begins 0.25 s late and has a gap of 0.5 s."""
    moved, pressed = rows(servo, 2_000), rows(force, 15, rate_hz=10.0)
    pressed["t_ns"] += 250_000_000
    pressed["t_ns"][8:] += 500_000_000
    moved["status"] = 2**32 - 1
    start = int(moved["t_ns"][0])
    with create("rates.mcap") as writer:
        writer.write("wheel_servo", moved)
        writer.write("force", pressed)
        writer.event(start + 500_000_000, "trial_start", 1, {"parameters": {"load": 2.0}})
        writer.event(start + 510_000_000, "step", 1, {"name": "drive"})
        writer.event(start + 1_500_000_000, "trial_end", 1, {"complete": True})
        path = writer._file.path
    return Recording.open(path)


def test_streams_of_several_rates_share_one_time_base(several_rates: Recording) -> None:
    table = joined_table(several_rates, ["wheel_servo", "force"], 100.0)
    moved, pressed = several_rates.read("wheel_servo"), several_rates.read("force")
    assert np.diff(table["t_ns"]).tolist() == [10_000_000] * (len(table) - 1)
    assert table["t_ns"][0] == moved["t_ns"][0]
    within = table["t_ns"] <= moved["t_ns"][-1]
    np.testing.assert_array_equal(table["wheel_servo.current"][within], moved["current"][::10])
    assert (table["wheel_servo.status"][within] == 2**32 - 1).all()
    for at, value in zip(table["t_ns"].tolist(), table["force.normal"].tolist(), strict=True):
        before = pressed[pressed["t_ns"] <= at]
        if not len(before) or at - before["t_ns"][-1] > 200_000_000:
            assert math.isnan(value)  # before the first sample, in the gap: nothing is made up
        else:
            assert value == before["normal"][-1]
    assert np.isnan(table["force.normal"]).sum() > 40
    assert (table["step"] == "drive").sum() == 99
    assert np.nanmax(table["trial_time"]) == pytest.approx(0.99)


def test_joined_table_is_nan_beyond_stream_end(
    create: Create, rows: MakeRows, servo: Stream, force: Stream, tmp_path: Path
) -> None:
    with create() as writer:
        writer.write("wheel_servo", rows(servo, 100))
        writer.write("force", rows(force, 1_000))
    table = joined_table(Recording.open(tmp_path / "run.mcap"), ["wheel_servo", "force"], 1000.0)
    assert len(table) == 1_000
    assert np.isfinite(table["wheel_servo.speed"]).sum() == 102
    assert np.isfinite(table["force.normal"]).all()


def test_rate_that_would_fill_memory_is_refused(several_rates: Recording) -> None:
    with pytest.raises(RecordingError, match="choose a lower rate"):
        joined_table(several_rates, ["force"], 1e8)
    with pytest.raises(RecordingError, match="0 Hz"):
        joined_table(several_rates, ["force"], 0.0)


@pytest.mark.parametrize("format", ["parquet", "csv", "mat"])
def test_other_programs_read_trials_and_joined_table(
    several_rates: Recording, tmp_path: Path, format: Format
) -> None:
    paths = export(several_rates, tmp_path / "out", format, base=TimeBase(50.0))
    assert [path.stem for path in paths[:4]] == ["joined", "events", "trials", "steps"]
    trials: Any
    expected = joined_table(several_rates, ["wheel_servo", "force"], 50.0)
    if format == "mat":
        joined = scipy.io.loadmat(paths[0], squeeze_me=True, simplify_cells=True)
        trials = scipy.io.loadmat(paths[2], squeeze_me=True, simplify_cells=True)
        np.testing.assert_array_equal(joined["force_normal"], expected["force.normal"])
        assert joined["units"]["force_normal"] == "N"
        assert joined["step_names"] == "drive"
        steps = np.where(joined["step"] == 1, "drive", "")
    elif format == "csv":
        frame = pd.read_csv(paths[0])
        np.testing.assert_array_equal(frame["force.normal [N]"], expected["force.normal"])
        steps = frame["step"].fillna("").to_numpy()
        trials = pd.read_csv(paths[2]).rename(columns=lambda name: name.split(" ")[0])
    else:
        frame = pd.read_parquet(paths[0])
        np.testing.assert_array_equal(frame["force.normal"], expected["force.normal"])
        steps = frame["step"].to_numpy()
        trials = pd.read_parquet(paths[2])
    assert (steps == expected["step"]).all()
    assert np.atleast_1d(trials["load"]).tolist() == [2.0]
    assert np.atleast_1d(trials["complete"]).astype(bool).tolist() == [True]
    assert np.atleast_1d(trials["start"]).tolist() == [0.5]
    assert np.atleast_1d(trials["end"]).tolist() == [1.5]


@pytest.fixture
def three_trials(
    create: Create, rows: MakeRows, servo: Stream, force: Stream, start_ns: int, tmp_path: Path
) -> Recording:
    """A recording of trials 1 to 3, each of 0.2 s with 0.1 s before it."""
    with create() as writer:
        writer.write("wheel_servo", rows(servo, 1_000))
        writer.write("force", rows(force, 10))
        for number in (1, 2, 3):
            begin_ns = start_ns + number * 300_000_000 - 200_000_000
            writer.event(begin_ns, "trial_start", number, {"parameters": {"load": number}})
            writer.event(begin_ns, "step", number, {"name": "drive"})
            writer.event(begin_ns + 200_000_000, "trial_end", number, {"complete": True})
    return Recording.open(tmp_path / "run.mcap")


@pytest.mark.parametrize("format", ["parquet", "csv", "mat", "hdf5", "mdf4"])
@pytest.mark.parametrize("base", [None, TimeBase(50.0)])
def test_chosen_trials_alone_are_exported(
    three_trials: Recording, tmp_path: Path, format: Format, base: TimeBase | None
) -> None:
    target = tmp_path / ("out.h5" if format == "hdf5" else "out.mf4" if format == "mdf4" else "out")
    paths = export(three_trials, target, format, base=base, trials=(1, 3))
    if format in ("mat", "hdf5", "mdf4"):
        assert _numbers(paths) == [1, 3]
        return
    read = pd.read_csv if format == "csv" else pd.read_parquet
    tables = {path.stem: read(path) for path in paths if path.suffix != ".json"}
    joined = ["joined"] if base else ["wheel_servo", "force"]
    assert [*tables] == [*joined, "events", "trials", "steps"]
    for name, table in tables.items():
        column = "number" if name == "trials" else "trial"
        assert set(table[column]) <= {1, 3}
        assert {1, 3} <= set(table[column]) or name == "force"
    assert len(tables["trials"]) == 2
    if not base:
        all_rows = three_trials.read("wheel_servo")["t_ns"]
        assert len(tables["wheel_servo"]) == 400 < len(all_rows)


def _numbers(paths: list[Path]) -> list[int]:
    """Return the numbers in the table of the trials."""
    if paths[0].suffix == ".h5":
        with h5py.File(paths[0]) as file:
            return [int(number) for number in file["trials/number"]]
    if paths[0].suffix == ".mf4":
        with asammdf.MDF(paths[0]) as mdf:
            return [int(number) for number in mdf.get("trials.number").samples]
    held: Any = scipy.io.loadmat(next(path for path in paths if path.stem == "trials"))
    return [int(number) for number in held["number"].ravel()]


def test_trials_to_export_are_named_as_in_reports(
    three_trials: Recording, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["export", str(three_trials.path), "--to", "csv", "--trials"]
    assert main([*command, "2-4"]) == 7
    assert "has no trial 4" in capsys.readouterr().err
    assert main([*command, "two"]) == 2
    assert "write --trials 1,4,7-9" in capsys.readouterr().err
    assert main([*command, "2-3"]) == 0
    folder = three_trials.path.with_suffix("")
    assert pd.read_csv(folder / "trials.csv")["number"].tolist() == [2, 3]
    assert (
        json.loads((folder / "metadata.json").read_text())["metadata"]["export"]["trials"] == "2, 3"
    )


def test_several_files_get_a_folder_each(
    several_rates: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("other.mcap").write_bytes(several_rates.path.read_bytes())
    command = ["export", "rates.mcap", "other.mcap", "--to", "csv", "--joined", "20 Hz"]
    assert main([*command, "--output", "tables"]) == 0
    first, second = (Path("tables", name, "joined.csv") for name in ("rates", "other"))
    assert first.read_bytes() == second.read_bytes()
    with pytest.raises(SystemExit):
        main(["export", "rates.mcap", "--to", "csv", "--joined", "3 m"])


def test_files_of_one_name_keep_their_folders(
    several_rates: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for day in ("monday", "friday"):
        Path(day).mkdir()
        Path(day, "run.mcap").write_bytes(several_rates.path.read_bytes())
    files = ["monday/run.mcap", "friday/run.mcap"]
    assert main(["export", *files, "--to", "csv", "--output", "tables"]) == 0
    assert sorted(path.parent for path in Path("tables").rglob("trials.csv")) == [
        Path("tables/friday/run"),
        Path("tables/monday/run"),
    ]
    Path("monday/run.MCAP").write_bytes(several_rates.path.read_bytes())
    files = ["monday/run.mcap", "monday/run.MCAP"]
    assert main(["export", *files, "--to", "csv", "--output", "others"]) == 2
    assert not Path("others").exists()
