"""HDF5 and MDF 4 hold all tables of a recording, bit for bit, as readers of others see them."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import asammdf
import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from rigd.cli.main import main
from rigd.model import Channel, Stream
from rigd.model.rows import row_dtype
from rigd.record import Recording, RecordingWriter
from rigd.record.export import Format, export
from rigd.record.read.joined_table import TimeBase, joined_batches
from rigd.record.read.tables import concatenated

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]
FIELDS = ("current", "speed", "counts", "status")
SUFFIX: dict[Format, str] = {"hdf5": ".h5", "mdf4": ".mf4"}


@pytest.fixture
def given(
    create: Create, rows: MakeRows, servo: Stream, force: Stream, start_ns: int
) -> NDArray[np.void]:
    """Rows of a recording run.mcap with one trial from 0.5 s to 1 s, its steps from 0.6 s."""
    moved = rows(servo, 1_500)
    moved["current"][3:6] = math.nan, math.inf, -0.0
    moved["speed"][4] = 5e-324
    with create() as writer:
        writer.write("wheel_servo", moved)
        writer.event(start_ns + 500_000_000, "trial_start", 7, {"parameters": {"load": 2.0},
                     "units": {"load": "N"}, "note": 'a "quoted", µ'})  # fmt: skip
        writer.event(start_ns + 600_000_000, "step", 7, {"name": "drive"})
        writer.event(start_ns + 800_000_000, "step", 7, {"name": "brake"})
        writer.event(start_ns + 1_000_000_000, "trial_end", 7, {"complete": True})
    return moved


def same_bits(found: NDArray[Any], given: NDArray[Any]) -> bool:
    return found.dtype == given.dtype and found.tobytes() == np.ascontiguousarray(given).tobytes()


def test_hdf5_has_the_bits_units_and_steps(given: NDArray[np.void], tmp_path: Path) -> None:
    recording = Recording.open(tmp_path / "run.mcap")
    (path,) = export(recording, tmp_path / "run.h5", "hdf5")
    with h5py.File(path) as file:
        servo = file["wheel_servo"]
        assert all(same_bits(servo[field][:], given[field]) for field in ("t_ns", *FIELDS))
        assert servo["current"].attrs["unit"] == "A"
        assert servo["current"].attrs["description"] == "motor current"
        assert servo.attrs["source"] == "sim-servo"
        names = servo["step_names"].asstr()[:]
        assert names[servo["step"][:]][[599, 600, 800, 1000]].tolist() == ["", "drive", "brake", ""]
        assert file["trials/load"][:].tolist() == [2.0]
        assert file["trials/load"].attrs["unit"] == "N"
        assert file["steps/duration"][:].tolist() == pytest.approx([0.2, 0.2])
        assert file["events/kind"].asstr()[:].tolist() == [
            "trial_start", "step", "step", "trial_end",
        ]  # fmt: skip
        assert json.loads(file["events/data"].asstr()[0])["note"] == 'a "quoted", µ'
        assert file["metadata/run"].attrs["procedure"] == "sweep"
        assert bytes(file["attachments/rig.yaml"][:]) == b"name: bench\n"
        assert len(file["force/normal"]) == 0


def test_mdf4_has_the_bits_units_and_steps(given: NDArray[np.void], tmp_path: Path) -> None:
    recording = Recording.open(tmp_path / "run.mcap")
    (path,) = export(recording, tmp_path / "run.mf4", "mdf4")
    with asammdf.MDF(path) as mdf:
        for field in ("t_ns", *FIELDS):
            assert same_bits(mdf.get(f"wheel_servo.{field}").samples, given[field]), field
        current = mdf.get("wheel_servo.current")
        assert (current.unit, current.comment) == ("A", "motor current")
        assert current.timestamps[1] == (given["t_ns"][1] - recording.start_ns) * 1e-9
        steps = mdf.get("wheel_servo.step").samples
        assert steps[[599, 600, 800, 1000]].tolist() == [b"", b"drive", b"brake", b""]
        load = mdf.get("trials.load")
        assert (load.samples.tolist(), load.unit) == ([2.0], "N")
        assert mdf.get("steps.step").samples.tolist() == [b"drive", b"brake"]
        note = json.loads(mdf.get("events.data").samples[0])["note"]
        assert note in ('a "quoted", µ', 'a "quoted", µ'.encode())
        assert mdf.header.abs_time == recording.start_ns
        assert json.loads(mdf.header.description)["run"]["procedure"] == "sweep"
        assert mdf.extract_attachment(0)[0] == b"name: bench\n"
        assert len(mdf.get("force.normal").samples) == 0


@pytest.mark.parametrize("format", SUFFIX)
def test_batches_give_the_same_as_whole(
    given: NDArray[np.void], tmp_path: Path, format: Format, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = Recording.open(tmp_path / "run.mcap")
    monkeypatch.setattr(Recording.batches, "__kwdefaults__", {"rows": 100})
    assert len(list(recording.batches("wheel_servo"))) > 1
    (path,) = export(recording, tmp_path / f"run{SUFFIX[format]}", format)
    if format == "hdf5":
        with h5py.File(path) as file:
            found = file["wheel_servo/status"][:]
    else:
        with asammdf.MDF(path) as mdf:
            found = mdf.get("wheel_servo.status").samples
    assert same_bits(found, given["status"])


@pytest.mark.parametrize("format", SUFFIX)
def test_existing_file_stays_unless_overwritten(
    given: NDArray[np.void], tmp_path: Path, format: Format, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    kept = Path(f"run{SUFFIX[format]}")
    kept.write_text("mine")
    assert main(["export", "run.mcap", "--to", format]) != 0
    assert kept.read_text() == "mine"
    assert main(["export", "run.mcap", "--to", format, "--overwrite"]) == 0
    assert kept.read_bytes() != b"mine"
    assert main(["export", "run.mcap", "--to", format, "--output", "in/a folder"]) == 0
    assert Path("in/a folder", kept).exists()


@pytest.fixture
def ramp(create: Create, start_ns: int, tmp_path: Path) -> Recording:
    """A ramp at 10 Hz with a gap of 0.5 s, whose value is its time in s, and times at 100 Hz."""
    slow, fast = Stream("slow", (Channel("ramp", "s"),)), Stream("fast", (Channel("x"),))
    at = np.delete(np.arange(20), range(8, 12))
    with create("ramp.mcap", streams=(slow, fast)) as writer:
        for name, ms in (("slow", at * 100 + 50), ("fast", np.arange(210) * 10)):
            stream = slow if name == "slow" else fast
            values = np.zeros(len(ms), row_dtype(stream))
            values["t_ns"] = start_ns + ms * 1_000_000
            values[stream.channels[0].name] = ms * 1e-3
            writer.write(name, values)
    return Recording.open(tmp_path / "ramp.mcap")


def between(recording: Recording, base: TimeBase) -> dict[str, NDArray[Any]]:
    table = concatenated(list(joined_batches(recording, ["slow", "fast"], base)))
    return dict(table.columns)


def test_linear_values_stop_at_gaps_and_ends(ramp: Recording) -> None:
    columns = between(ramp, TimeBase(stream="fast", between="linear"))
    time, found = columns["time"], columns["slow.ramp"]
    ms = np.round(time * 1e3)
    inside = (ms >= 50) & (ms <= 1950) & ~((ms > 750) & (ms < 1250))
    np.testing.assert_allclose(found[inside], time[inside], atol=1e-9)
    assert np.isnan(found[~inside]).all()  # nothing outside, nothing across the gap
    np.testing.assert_array_equal(columns["fast.x"], ramp.read("fast")["x"])


@pytest.mark.parametrize("between_samples", ["last", "linear"])
def test_samples_on_their_own_times_keep_bits(ramp: Recording, between_samples: Any) -> None:
    columns = between(ramp, TimeBase(stream="slow", between=between_samples))
    assert same_bits(columns["slow.ramp"], ramp.read("slow")["ramp"])
    assert same_bits(columns["t_ns"], ramp.read("slow")["t_ns"])


def test_unknown_time_base_names_the_streams(
    given: NDArray[np.void], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["export", str(tmp_path / "run.mcap"), "--to", "csv", "--on"]
    assert main([*command, "wheel_servo.nothing"]) == 7
    assert "wheel_servo" in capsys.readouterr().err
    assert main([*command, "wheel_servo.current"]) == 0


def test_damaged_recording_exports_what_is_intact(
    given: NDArray[np.void], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.mcap"
    index = Recording.open(path).contents.chunks[0]
    data = bytearray(path.read_bytes())
    data[index.chunk_start_offset + index.chunk_length // 2] ^= 0xFF
    path.write_bytes(data)
    assert main(["export", str(path), "--to", "hdf5"]) == 0
    assert "warning:" in capsys.readouterr().err
    with h5py.File(tmp_path / "run.h5") as file:
        left = file["wheel_servo/t_ns"][:]
        assert 0 < len(left) < 1_500
        assert set(left.tolist()) <= set(given["t_ns"].tolist())
        assert file["metadata/export"].attrs["damage"]


LIMITED = """
import resource, sys
from rigd.cli.main import main
from rigd.record.export import hdf5, mdf4, arrow, mat
resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, resource.RLIM_INFINITY))
for format in sys.argv[1:]:
    print(main(["export", "run.mcap", "--to", format, "--output", f"out-{format}"]), flush=True)
"""


def test_full_disk_leaves_no_half_file(given: NDArray[np.void], tmp_path: Path) -> None:
    formats = ["parquet", "csv", "mat", "hdf5", "mdf4"]
    command = [sys.executable, "-c", LIMITED, *formats]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["7"] * 5, done.stderr
    assert done.stderr.count("cannot export to") == 5
    assert [path for path in tmp_path.rglob("out-*/*")] == []


def test_missing_extra_is_named_before_writing(
    given: NDArray[np.void],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, "asammdf", None)
    assert main(["export", str(tmp_path / "run.mcap"), "--to", "mdf4"]) == 2
    assert "pip install 'rigd[export]'" in capsys.readouterr().err
