"""What was exported comes back bit for bit: samples, times, trials, parameters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from rigd.importing import import_files, parse_map
from rigd.model import Channel, ConfigError, Stream
from rigd.model.rows import row_dtype
from rigd.record import Recording, RecordingWriter
from rigd.record.export import Format, export

START_NS = 1_790_000_000_123_456_789
FAST = Stream("force", (Channel("normal", "N"), Channel("tangential", "N")))
SLOW = Stream("speed", (Channel("speed", "m/s"),))
MAP = """\
map: bench
rig: old_bench
sources:
  force:
    file: "{test}/force.FORMAT"
    text: {missing: nan}
    time: {column: t_ns, since: 1970-01-01}
    channels: {normal: {column: normal}, tangential: {column: tangential}}
  speed:
    file: "{test}/speed.FORMAT"
    text: {missing: nan}
    time: {column: t_ns, since: 1970-01-01}
    channels: {speed: {column: speed}}
ignore: [events.FORMAT, steps.FORMAT, metadata.json]
trials:
  columns: trial
  outside: "-1"
  steps: step
  table: {file: "{test}/trials.FORMAT", key: number}
parameters:
  load: {column: load, unit: kg}
  floor: {column: floor}
"""


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Two streams of different rates, of all kinds of numbers, and two trials."""
    path = tmp_path_factory.mktemp("original") / "old.mcap"
    rng = np.random.default_rng(3)
    with RecordingWriter.create(
        path,
        streams=[FAST, SLOW],
        metadata={"run": {"procedure": "p", "rig": "bench"}},
        attachments=[],
        start_ns=START_NS,
        sync_interval_s=None,
    ) as writer:
        for stream, count, period_ns in ((FAST, 3000, 333_333), (SLOW, 1000, 1_000_001)):
            rows = np.zeros(count, row_dtype(stream))
            rows["t_ns"] = START_NS + np.arange(count) * period_ns
            for channel in stream.channels:
                rows[channel.name] = rng.normal(size=count) * 10.0 ** rng.integers(-300, 300, count)
            rows[stream.channels[0].name][:6] = [np.nan, -0.0, 5e-324, 1.7e308, 0.1, 1 / 3]
            writer.write(stream.name, rows)
        for number, begin in ((1, 100), (2, 600)):
            start = START_NS + begin * 1_000_001
            about = {"number": number, "repeat": 1, "parameters": {"load": 0.1 * number,
                     "floor": "pvc"}, "units": {"load": "kg"}}  # fmt: skip
            writer.event(start, "trial_start", number, about)
            writer.event(start, "step", number, {"name": "up"})
            writer.event(start + 50_000_000, "step", number, {"name": "on, and on"})
            writer.event(start + 300_000_000, "trial_end", number, {"complete": True})
    return Recording.open(path)


@pytest.mark.parametrize("format", ["csv", "parquet"])
def test_exported_recording_comes_back_bit_for_bit(
    original: Recording, tmp_path: Path, format: Format
) -> None:
    files = export(original, tmp_path / "old", format)
    what = parse_map(MAP.replace("FORMAT", format), Path("m.yaml"))
    (made,) = import_files(what, files, tmp_path / "runs")
    again = Recording.open(made.path)
    for stream in ("force", "speed"):
        assert again.read(stream).tobytes() == original.read(stream).tobytes()
        assert [c.unit for c in again.streams[stream].channels] == [
            c.unit for c in original.streams[stream].channels
        ]
    assert [(t.number, t.parameters, t.units) for t in again.trials] == [
        (t.number, t.parameters, t.units) for t in original.trials
    ]
    for trial, before in zip(again.trials, original.trials, strict=True):
        assert trial["force"].columns["t_ns"].tolist() == before["force"].columns["t_ns"].tolist()
        assert [step.name for step in trial.steps] == ["up", "on, and on"]
    files = export(again, tmp_path / "again", format, streams=["force", "speed"])
    for described, path in zip((FAST, SLOW), files, strict=False):
        channels = [channel.name for channel in described.channels]
        assert samples(path, channels) == samples(tmp_path / "old" / path.name, channels)


def samples(path: Path, channels: list[str]) -> list[bytes]:
    """Return times and channels of an exported table: lines of CSV, or bytes of each column."""
    if path.suffix == ".csv":
        lines = path.read_bytes().splitlines()
        return [b",".join([cells[0], *cells[-len(channels) :]])
                for cells in (line.split(b",") for line in lines)]  # fmt: skip
    table = pq.read_table(path)
    return [table.column(name).to_numpy().tobytes() for name in ("t_ns", *channels)]


@pytest.mark.parametrize(
    ("format", "ending", "prefix"), [("hdf5", "h5", ""), ("mdf4", "mf4", "STREAM.")]
)
def test_one_file_comes_back_bit_for_bit(
    original: Recording, tmp_path: Path, format: Format, ending: str, prefix: str
) -> None:
    files = export(original, tmp_path / f"old.{ending}", format)
    text = "map: bench\nrig: old_bench\nsources:\n"
    for stream in (FAST, SLOW):
        own = prefix.replace("STREAM", stream.name)
        names = ", ".join(f"{c.name}: {{column: {own}{c.name}}}" for c in stream.channels)
        text += f"""\
  {stream.name}:
    file: "*.{ending}"
    group: {stream.name}
    time: {{column: {own}t_ns, since: 1970-01-01}}
    channels: {{{names}}}
"""
    own = prefix.replace("STREAM", "force")
    text += f"trials: {{columns: {own}trial, outside: '-1'}}\n"
    (made,) = import_files(parse_map(text, Path("m.yaml")), files, tmp_path / "runs")
    again = Recording.open(made.path)
    for name in ("force", "speed"):
        assert again.read(name).tobytes() == original.read(name).tobytes()
    assert [trial.number for trial in again.trials] == [1, 2]


def test_cut_parquet_file_is_named(original: Recording, tmp_path: Path) -> None:
    files = export(original, tmp_path / "old", "parquet")
    files[0].write_bytes(files[0].read_bytes()[:-200])
    what = parse_map(MAP.replace("FORMAT", "parquet"), Path("m.yaml"))
    with pytest.raises(ConfigError, match="cut off, damaged or no Parquet"):
        import_files(what, files, tmp_path / "runs")
    assert list((tmp_path / "runs").iterdir()) == []
