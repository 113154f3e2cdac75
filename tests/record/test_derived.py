"""Channels computed of a recording: equal to those of the run, or to numpy on the same rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rigd
from rigd.model import ConfigError, RecordingError
from rigd.model.channels import STALE, STATUS_FIELD, Channel, Stream
from rigd.model.rows import TIME_FIELD, row_dtype
from rigd.record import Attachment, Recording, RecordingWriter
from rigd.record.events.gaps import Gap

START_NS = 1_790_000_000_000_000_000

#: Channels of the run; below `again` the same ones, after the fact.
DERIVED: Mapping[str, Mapping[str, str]] = {
    "{0}rim.speed": {"is": "derivative(wheel_encoder.angle) * rig.wheel_radius",
                     "lowpass": "50 Hz"},
    "{0}rim.drive": {"is": "wheel_servo.current_setpoint / ${current}"},
    "{0}motion.slip": {"is": "{0}rim.speed - derivative(carriage.position)", "unit": "m/s"},
    "{0}motion.slipped": {"is": "integral(abs({0}motion.slip))", "reset": "trial"},
    "{0}motion.level": {"is": "mean({0}motion.slip, 50 ms)", "where": "{0}motion.slip > 1 mm/s"},
    "{0}motion.late": {"is": "delay(highest({0}motion.slip, 20 ms), 10 ms) + ${shift}"},
}  # fmt: skip
PROCEDURE = """\
procedure: push
title: Push
doc: Two trials with memory.
parameters:
  current: {doc: Current, unit: A, default: 0.6 A}
  shift: {doc: A constant, unit: mm/s, default: 3 mm/s}
  floor: {doc: Floor, choices: [pvc, paper], default: pvc}
sweep: {zip: {floor: [pvc, paper], current: [0.6 A, 0.5 A]}}
derived:
"""
STEPS = """\
trial:
  steps:
    - step: push
      set: {longitudinal_belt.engaged: 0, wheel_servo.current: "${current}"}
      for: 0.2 s
    - step: slow
      set: {wheel_servo.current: 0.1 A}
      for: 0.1 s
"""


def named(prefix: str) -> dict[str, dict[str, str]]:
    return {
        name.replace("{0}", prefix): {k: v.replace("{0}", prefix) for k, v in keys.items()}
        for name, keys in DERIVED.items()
    }


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    folder = tmp_path_factory.mktemp("played")
    lines = [f'  {n}: {{{", ".join(f"{k}: {v!r}" for k, v in keys.items())}}}\n'
             for n, keys in named("").items()]  # fmt: skip
    (folder / "push.yaml").write_text(PROCEDURE + "".join(lines) + STEPS)
    return rigd.run(folder / "push.yaml", rig="lugre-1", out=folder / "push.mcap")


@pytest.mark.parametrize("group", ["rim", "motion"])
def test_computed_channels_equal_those_of_run(played: Recording, group: str) -> None:
    again = played.with_derived(named("again_"))
    rows, expected = again.read(f"again_{group}"), played.read(group)
    assert len(expected) > 600
    assert rows.tobytes() == expected.tobytes()
    assert np.isfinite(expected["slip" if group == "motion" else "speed"]).all()


def test_swept_parameter_counts_while_rig_runs(played: Recording) -> None:
    for trial, current in zip(played.trials, (0.6, 0.5), strict=True):
        rows = played.read("rim", trial.start_ns, trial.end_ns)
        written = played.read("wheel_servo", trial.start_ns - 1_000_000, trial.end_ns)
        written = written[np.searchsorted(written[TIME_FIELD], rows[TIME_FIELD]) - 1]
        assert len(rows) >= 300
        assert np.array_equal(rows["drive"], written["current_setpoint"] / current)
        assert not rows[STATUS_FIELD].any()
    outside = played.read("rim", played.trials[-1].end_ns + 1)
    assert np.isnan(outside["drive"]).all()


BENCH = Stream("bench", (Channel("fx", "N"), Channel("fz", "N"), Channel("v", "m/s")))
SLOW = Stream("room", (Channel("t", "K"),), has_status=True)
RIG = """\
rig: bench
title: A bench
cycle: 1 kHz
devices: {bench: {driver: not-installed-here}}
interlocks: []
constants: {arm: 40 mm}
"""


@pytest.fixture
def bench(tmp_path: Path) -> Recording:
    """Two trials of another program's kind: no cycle, 1 kHz and 10 Hz, swept loads."""
    path, count = tmp_path / "bench.mcap", 2000
    rng = np.random.default_rng(4)
    rows = np.zeros(count, row_dtype(BENCH))
    rows[TIME_FIELD] = START_NS + np.arange(count) * 1_000_000
    for name in ("fx", "fz", "v"):
        rows[name] = rng.normal(5.0, 1.0, count)
    slow = np.zeros(20, row_dtype(SLOW))
    slow[TIME_FIELD] = START_NS + np.arange(20) * 100_000_000
    slow["t"] = 290.0 + np.arange(20)
    slow[STATUS_FIELD][5] = STALE
    metadata = {
        "run": {"rig": "bench", "procedure": "slide", "mode": "imported"},
        "parameters": {"offset": "20 mN", "pin": "steel"},
    }
    with RecordingWriter.create(
        path, streams=[BENCH, SLOW], metadata=metadata, start_ns=START_NS,
        attachments=[Attachment("rig.yaml", "application/yaml", RIG.encode())],
    ) as writer:  # fmt: skip
        writer.write("bench", rows)
        writer.write("room", slow)
        for number, load in ((1, 10.0), (2, 20.0)):
            begin = START_NS + (number - 1) * 1_000_000_000
            about = {"number": number, "parameters": {"load": load}, "units": {"load": "N"}}
            writer.event(begin, "trial_start", number, about)
            writer.event(begin + 900_000_000, "trial_end", number, {"complete": True})
    return Recording.open(path)


def test_computed_values_equal_numpy(bench: Recording) -> None:
    table = bench.compute("(bench.fx - ${offset}) / bench.fz")
    rows = bench.read("bench")
    assert np.array_equal(table["value"], (rows["fx"] - 0.02) / rows["fz"])
    assert table.units["value"] == "1"
    assert np.array_equal(table[TIME_FIELD], rows[TIME_FIELD])
    power = bench.compute("bench.fx * bench.v * ${rig.arm} / rig.arm", unit="mW")
    assert power.units["value"] == "W"
    np.testing.assert_allclose(power["value"], rows["fx"] * rows["v"], rtol=1e-15)


def test_swept_parameter_has_value_of_trial(bench: Recording) -> None:
    table = bench.compute("bench.fx / ${load}")
    fx, at_ms = bench.read("bench")["fx"], np.arange(2000)
    load = np.where(at_ms < 1000, 10.0, 20.0)
    expected = np.where(at_ms % 1000 < 900, fx / load, np.nan)
    assert np.array_equal(table["value"], expected, equal_nan=True)
    # A reader of samples leaves out those between trials.
    assert np.array_equal(table[STATUS_FIELD] != 0, at_ms % 1000 >= 900)
    second = bench.with_derived({"mu.x": "bench.fx / ${load}"}).trial(2)["mu"]
    assert np.array_equal(second["x"], expected[1000:1900])


def test_streams_of_two_rates_stand_at_slower(bench: Recording) -> None:
    table = bench.compute("bench.fx * room.t")
    assert len(table) == 20
    fx, at_ms = bench.read("bench")["fx"], np.arange(2000)
    off_ms = np.abs(at_ms[:, None] - np.arange(0, 2000, 100))
    weights = np.where(off_ms < 50, 1.0, np.where(off_ms == 50, 0.5, 0.0))
    expected = (fx[:, None] * weights).sum(axis=0) / weights.sum(axis=0) * (290.0 + np.arange(20))
    late = np.arange(20) == 5  # the row repeats the reading before it
    assert np.array_equal(table[STATUS_FIELD] != 0, late)
    np.testing.assert_allclose(table["value"], np.where(late, np.nan, expected), rtol=1e-12)


def test_trial_that_lost_rows_of_input_is_incomplete(bench: Recording) -> None:
    lost = Gap("bench", START_NS + 100_000_000, START_NS + 110_000_000, 10)
    damaged = replace(bench, gaps=(lost,)).with_derived({"mu.x": "bench.fx / bench.fz"})
    assert [trial.complete for trial in damaged.trials_for({"mu"})] == [False, True]
    assert [trial.complete for trial in damaged.trials_for({"room"})] == [True, True]


@pytest.mark.parametrize(
    ("derived", "words"),
    [
        ({"mu.x": "bench.fx + bench.v"}, ["derived:3:21", "cannot add m/s and N"]),
        ({"mu.x": "bench.fy / bench.fz"}, ["derived:3:10", "'bench.fy'", "did you mean 'bench.f"]),
        ({"mu.x": "mu.y * 2", "mu.y": "mu.x / 2"}, ["mu.x uses mu.y uses mu.x"]),
        ({"bench.mu": "bench.fx / bench.fz"}, ["has the stream bench already", "'bench_derived'"]),
        ({"mu.x": {"is": "bench.fx", "unit": "m"}}, ["the formula gives N, not m"]),
        ({"mu.x": "bench.fx / ${lod}"}, ["unknown name '${lod}'", "did you mean 'load'?"]),
        ({"mu.x": "bench.fx * ${pin}"}, ["pin is a word"]),
        ({"mu.x": "lowpass(bench.fx, 400 Hz)"}, ["at most 250 Hz"]),
        ({"mu.x": {"is": "bench.fx", "uint": "N"}}, ["unknown key 'uint'"]),
    ],
)  # fmt: skip
def test_wrong_channel_is_named_with_place(
    bench: Recording, derived: dict[str, str], words: list[str]
) -> None:
    with pytest.raises(ConfigError) as caught:
        bench.with_derived(derived)
    for text in words:
        assert text in str(caught.value)


def test_unknown_derived_stream_is_refused(bench: Recording) -> None:
    again = bench.with_derived({"mu.x": "bench.fx / bench.fz"})
    assert again.info.streams[-1].rows == 2000
    assert (
        again.with_derived({"nu.x": "mu.x * 2"}).read("nu")["x"][0] == 2 * again.read("mu")["x"][0]
    )
    with pytest.raises(RecordingError, match="no stream 'nu'"):
        again.read("nu")
    assert len(again.read("mu", START_NS + 5_000_000, START_NS + 9_000_000)) == 4
    assert sum(map(len, again.batches("mu", rows=300))) == 2000
