"""Names that the formats of other programs would mix up lose no column."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io

from rigd.model import Channel, RecordingError, Stream
from rigd.record import Recording, RecordingWriter, add_metadata
from rigd.record.export import export
from rigd.record.read.joined_table import TimeBase

Record = Callable[[dict[str, list[str]]], Recording]


@pytest.fixture
def record(create: Callable[..., RecordingWriter], rows: Any, tmp_path: Path) -> Record:
    """Records streams with the channels of these names; the n-th channel is n everywhere."""

    def make(channels: dict[str, list[str]]) -> Recording:
        streams = [
            Stream(name, tuple(Channel(item, "N") for item in names))
            for name, names in channels.items()
        ]
        with create(streams=streams) as writer:
            for stream in streams:
                given = rows(stream, 10)
                for number, channel in enumerate(stream.channels):
                    given[channel.name] = number
                writer.write(stream.name, given)
            writer.event(int(given["t_ns"][0]), "step", None, {"name": "pull"})
        return Recording.open(tmp_path / "run.mcap")

    return make


OWN = ["units", "recording", "metadata", "step_names"]


def test_mat_keeps_channels_named_like_its_own(record: Record, tmp_path: Path) -> None:
    paths = export(record({"cam": OWN}), tmp_path, "mat", streams=["cam"])
    content = scipy.io.loadmat(paths[0], squeeze_me=True, simplify_cells=True)
    for number, name in enumerate(OWN):
        assert content[name].tolist() == [number] * 10
    assert content["rigd_units"]["units"] == "N"
    assert content["rigd_recording"] == "run.mcap"
    assert content["rigd_step_names"] == "pull"
    assert "sweep" in content["rigd_metadata"]


def test_mat_refuses_two_columns_of_one_name(record: Record, tmp_path: Path) -> None:
    recording = record({"wheel": ["servo_speed"], "wheel_servo": ["speed"]})
    words = r"wheel\.servo_speed and wheel_servo\.speed would both be wheel_servo_speed in MATLAB"
    with pytest.raises(RecordingError, match=words):
        export(recording, tmp_path / "out", "mat", base=TimeBase(100.0))
    assert not list((tmp_path / "out").iterdir())


def test_hdf5_keeps_streams_named_like_its_own(record: Record, tmp_path: Path) -> None:
    recording = record({"metadata": ["run"], "attachments": ["x"], "cam": ["x", "step_names"]})
    (path,) = export(recording, tmp_path / "run.h5", "hdf5")
    with h5py.File(path) as file:
        assert file["metadata/run"][:].tolist() == [0.0] * 10
        assert file["attachments/x"][:].tolist() == [0.0] * 10
        assert file["cam/step_names"][:].tolist() == [1.0] * 10
        assert file["cam/rigd_step_names"].asstr()[:].tolist() == ["", "pull"]
        assert file["rigd_metadata/run"].attrs["procedure"] == "sweep"
        assert np.asarray(file["rigd_attachments/rig.yaml"]).tobytes() == b"name: bench\n"


def test_hdf5_keeps_metadata_of_any_name(record: Record, tmp_path: Path) -> None:
    path = record({"cam": ["x"]}).path
    names = {"": "unnamed", "/": "rigd_unnamed", "a/b": "a/b", "a//./c": "a/c", "run/": "rigd_run"}
    add_metadata(path, {name: {"": "odd", "k\0": "v\0" * 9, "long": "x" * 10**5} for name in names})
    (path,) = export(Recording.open(path), tmp_path / "run.h5", "hdf5")
    with h5py.File(path) as file:
        assert file["metadata/run"].attrs["procedure"] == "sweep"
        for at in names.values():
            found = dict(file[f"metadata/{at}"].attrs)
            assert found == {"unnamed": "odd", "k": "v" * 9, "long": "x" * 10**5}


def test_hdf5_refuses_channel_named_like_a_stream(record: Record, tmp_path: Path) -> None:
    recording = record({"imu": ["data"], "imu/data": ["x"]})
    with pytest.raises(RecordingError, match="both be 'imu/data' in HDF5"):
        export(recording, tmp_path / "run.h5", "hdf5")
    assert not list(tmp_path.glob("run.h5*"))
