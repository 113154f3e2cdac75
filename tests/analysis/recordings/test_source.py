"""Signals of a recording: of one rate, of several, with late rows."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rigd.analysis.recordings.source import RecordedSweep, open_sweep
from rigd.model.channels import STALE, Channel, Stream
from rigd.model.errors import DataError
from rigd.model.rows import row_dtype
from rigd.procedure.program import IdentifyPlan
from rigd.record import RecordingWriter, add_metadata

START_NS = 1_790_000_000_000_000_000
TRUTH = Stream("truth", (Channel("speed", "m/s"),))
ENCODER = Stream("encoder", (Channel("angle", "rad"),), has_status=True)
CARD = Stream("card", (Channel("acceleration", "m/s^2"),), has_status=True)
TRIAL_MS = (100, 1100)

Rows = NDArray[np.void]
Make = Callable[..., RecordedSweep]


def rows_of(stream: Stream, rate_hz: float, seconds: float = 1.2) -> Rows:
    """Return rows whose value is their time in s."""
    rows = np.zeros(round(rate_hz * seconds), row_dtype(stream))
    at_s = np.arange(len(rows)) / rate_hz
    rows["t_ns"] = START_NS + np.rint(at_s * 1e9).astype(np.int64)
    rows[stream.channels[0].name] = at_s
    return rows


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """Record the two streams; the plan has a signal of each, ``first`` first, and what is said."""

    def record(
        encoder: Rows,
        card: Rows,
        first: str = "angle",
        *,
        held: bool = False,
        lacks: Sequence[str] = (),
        **said: dict[str, object],
    ) -> RecordedSweep:
        signals = {"angle": "encoder.angle", "acceleration": "card.acceleration"}
        ordered = dict(sorted(signals.items(), key=lambda item: item[0] != first))
        plan = {
            "model": "lugre", "signals": json.dumps(ordered), "constants": "{}", "group_by": "[]",
            **{name: json.dumps(value) for name, value in said.items()},
        }  # fmt: skip
        for name in lacks:
            del plan[name]
        path = tmp_path / "run.mcap"
        with RecordingWriter.create(
            path, streams=[ENCODER, CARD, TRUTH], metadata={"identify": plan}, attachments=(),
            start_ns=START_NS, sync_interval_s=None,
        ) as writer:  # fmt: skip
            begin, end = (START_NS + ms * 1_000_000 for ms in TRIAL_MS)
            writer.event(begin, "trial_start", 1, {})
            writer.event(begin, "step", 1, {"name": "go"})
            for phase, ms in (("held", 300), ("returning", 400), ("over", 450)) if held else ():
                writer.event(START_NS + ms * 1_000_000, "hold", 1, {"step": "go", "phase": phase})
            writer.write("encoder", encoder)
            writer.write("card", card)
            writer.write("truth", rows_of(TRUTH, 1000))
            writer.event(end, "trial_end", 1, {"complete": True})
        return open_sweep(path)

    return record


@pytest.mark.parametrize(("value", "shown"), [(None, "None"), ([], "[]"), (0.5, "0.5 A")])
def test_parameter_of_any_kind_is_written(make: Make, value: object, shown: str) -> None:
    sweep = make(rows_of(ENCODER, 1000), rows_of(CARD, 1000))
    trial = replace(sweep.trials[0], parameters={"current": value}, units={"current": "A"})
    assert sweep.parameter(trial, "current") == shown


def test_signals_of_one_rate_are_not_resampled(make: Make) -> None:
    encoder, card = rows_of(ENCODER, 1000), rows_of(CARD, 1000)
    sweep = make(encoder, card)
    t_s, signals = sweep.signals(sweep.trials[0])
    assert np.array_equal(signals["angle"], encoder["angle"][100:1100])
    assert np.array_equal(signals["acceleration"], card["acceleration"][100:1100])
    assert t_s == pytest.approx(np.arange(1000) * 1e-3)


def test_faster_stream_is_averaged_to_times_of_first(make: Make) -> None:
    sweep = make(rows_of(ENCODER, 1000), rows_of(CARD, 9600))
    t_s, signals = sweep.signals(sweep.trials[0])
    assert len(t_s) == len(signals["angle"]) == len(signals["acceleration"]) == 1000
    assert signals["acceleration"] == pytest.approx(signals["angle"], abs=0.5 / 9600)


def test_samples_of_faster_stream_are_given_as_recorded(make: Make) -> None:
    encoder, card = rows_of(ENCODER, 1000), rows_of(CARD, 4000)
    sweep = make(encoder, card)
    _, _, faster = sweep.signals_and_faster(sweep.trials[0])
    assert list(faster) == ["acceleration"]
    assert np.isin(faster["acceleration"], card["acceleration"]).all()
    assert len(faster["acceleration"]) == pytest.approx(4000, abs=8)


def test_samples_beside_the_trial_are_averaged(make: Make) -> None:
    """Half a period before the trial's first row belongs to that row: its mean is not beside it."""
    sweep = make(rows_of(ENCODER, 1000), rows_of(CARD, 100_000))
    _, signals = sweep.signals(sweep.trials[0])
    assert signals["acceleration"][0] == pytest.approx(0.1, abs=1e-5)


def test_slowest_stream_gives_times_whichever_is_named_first(make: Make) -> None:
    sweep = make(rows_of(ENCODER, 1000), rows_of(CARD, 9600), first="acceleration")
    t_s, signals = sweep.signals(sweep.trials[0])
    assert len(t_s) == 1000
    assert signals["acceleration"] == pytest.approx(signals["angle"], abs=0.5 / 9600)


def test_a_stream_that_is_hardly_faster_is_refused(make: Make) -> None:
    sweep = make(rows_of(ENCODER, 1000), rows_of(CARD, 1500))
    with pytest.raises(DataError, match="stream 'card' does not fit"):
        sweep.signals(sweep.trials[0])


def test_uneven_times_are_named_where_they_matter(make: Make) -> None:
    """It was "does not fit the others", also of a single stream."""
    encoder = rows_of(ENCODER, 1000)
    encoder["t_ns"] += np.random.default_rng(1).integers(-200_000, 200_000, len(encoder))
    sweep = make(encoder, rows_of(CARD, 9600))
    with pytest.raises(
        DataError, match=r"times of stream 'encoder' are uneven: steps of 0\.6.* ms"
    ):
        sweep.signals(sweep.trials[0])


@pytest.mark.parametrize("rate_hz", [1000, 9600])
def test_a_gap_is_refused_at_any_rate(make: Make, rate_hz: int) -> None:
    card = rows_of(CARD, rate_hz)
    late = np.delete(card, slice(rate_hz // 2, rate_hz // 2 + rate_hz // 50))
    sweep = make(rows_of(ENCODER, 1000), late)
    with pytest.raises(DataError, match="in trial 1, stream 'card' does not fit"):
        sweep.signals(sweep.trials[0])


def test_few_late_or_missing_samples_are_bridged(make: Make) -> None:
    encoder, card = rows_of(ENCODER, 1000), rows_of(CARD, 1000)
    encoder["angle"][500] = -1e6  # with any repeated value
    encoder["status"][[50, 500]] = STALE  # the first one is before the trial
    keep = np.delete(np.arange(len(encoder)), [700, 701])  # cycles that were missed
    sweep = make(encoder[keep], card[keep])
    t_s, signals = sweep.signals(sweep.trials[0])
    assert t_s == pytest.approx(np.arange(1000) * 1e-3, abs=1e-9)
    for signal in signals.values():
        assert signal == pytest.approx(0.1 + t_s, abs=1e-9)
    assert sweep.bridged(sweep.trials[0]) == 1 + 2 * 2


@pytest.mark.parametrize(
    ("late", "words"),
    [(slice(200, 800, 20), r"30 of 1000 samples \(3 %\)"), (slice(400, 411), "11 samples in succ")],
)
def test_many_late_rows_are_refused(make: Make, late: slice, words: str) -> None:
    encoder = rows_of(ENCODER, 1000)
    encoder["status"][late] = STALE
    sweep = make(encoder, rows_of(CARD, 1000))
    with pytest.raises(DataError, match=rf"stream 'encoder' .* {words}"):
        sweep.signals(sweep.trials[0])


def test_late_rows_of_faster_stream_are_not_averaged(make: Make) -> None:
    card = rows_of(CARD, 9600)
    card["acceleration"][4800:4803] = 1e6  # with any repeated values
    card["status"][4800:4803] = STALE
    sweep = make(rows_of(ENCODER, 1000), card)
    _, signals = sweep.signals(sweep.trials[0])
    assert signals["acceleration"] == pytest.approx(signals["angle"], abs=3 / 9600)
    assert sweep.bridged(sweep.trials[0]) == 3


def test_damage_is_skipped_and_reported(make: Make) -> None:
    """The trial that lost samples is not used; nothing else is lost, and no repair is needed."""
    sweep = make(rows_of(ENCODER, 1000), rows_of(CARD, 1000))
    assert len(sweep.trials) == 1
    assert sweep.info.losses == ()
    content = bytearray(sweep.path.read_bytes())
    first = next(
        chunk for chunk in sweep.recording.contents.chunks if 2 in chunk.message_index_offsets
    )
    content[first.chunk_start_offset + 200] ^= 1
    sweep.path.write_bytes(content)
    damaged = open_sweep(sweep.path)
    assert damaged.trials == ()
    said = "\n".join(damaged.info.losses)
    assert "is damaged; the damaged parts were skipped" in said
    assert "rows of encoder" in said
    assert "trial 1 (lost: " in said
    assert len(damaged.recording.read("card")) == 1200
    assert sweep.path.read_bytes() == content


def test_rows_that_no_signal_needs_cost_no_trial(make: Make) -> None:
    sweep = make(rows_of(ENCODER, 1000), rows_of(CARD, 1000))
    content = bytearray(sweep.path.read_bytes())
    first = next(
        chunk for chunk in sweep.recording.contents.chunks if 4 in chunk.message_index_offsets
    )
    content[first.chunk_start_offset + 200] ^= 1
    sweep.path.write_bytes(content)
    damaged = open_sweep(sweep.path)
    assert [trial.number for trial in damaged.trials] == [1]
    assert "rows of truth" in "\n".join(damaged.info.losses)
    assert [trial.complete for trial in damaged.recording.trials] == [False]
    times, signals = damaged.signals(damaged.trials[0])
    assert len(times) == len(signals["angle"]) == 1000


def test_constant_has_uncertainty_given_in_recording(make: Make) -> None:
    sweep = make(
        rows_of(ENCODER, 1000),
        rows_of(CARD, 1000),
        constants={"mass": -4.0, "radius": 0.05, "gravity": 9.81},
        uncertainties={
            "mass": {"size": 0.01, "is_share": True},
            "radius": {"size": 1e-4, "is_share": False},
        },
    )
    trial = sweep.trials[0]
    assert sweep.uncertainty(trial, "mass") == pytest.approx(0.04)
    assert sweep.uncertainty(trial, "radius") == 1e-4
    assert sweep.uncertainty(trial, "gravity") is None
    with pytest.raises(DataError, match="inertia"):
        sweep.uncertainty(trial, "inertia")


def test_a_recording_without_uncertainties_gives_none(make: Make) -> None:
    sweep = make(rows_of(ENCODER, 1000), rows_of(CARD, 1000), constants={"mass": 4.0})
    assert sweep.uncertainty(sweep.trials[0], "mass") is None


def test_trial_that_was_held_is_not_analysed(make: Make) -> None:
    sweep = make(rows_of(ENCODER, 1000), rows_of(CARD, 1000), held=True)
    assert not sweep.trials
    assert [trial.reason for trial in sweep.info.trials] == ["held by a pause in step 'go'"]
    (trial,) = sweep.recording.trials
    assert trial.complete
    table = trial["encoder"]
    at_s, step = np.asarray(table["trial_time"]), np.asarray(table["step"])
    assert (step[(at_s > 0.2) & (at_s < 0.35)] == "").all()
    assert (step[(at_s < 0.19) | (at_s > 0.36)] == "go").all()


def test_recorded_plan_needs_its_model_alone(make: Make) -> None:
    lacks = ("signals", "constants", "group_by")
    sweep = make(rows_of(ENCODER, 1000), rows_of(CARD, 1000), lacks=lacks)
    assert sweep.plan == IdentifyPlan("lugre", {}, {})
    with pytest.raises(DataError, match="names no signals"):
        sweep.signals(sweep.trials[0])


def test_recorded_plan_without_model_is_refused(make: Make) -> None:
    with pytest.raises(DataError, match=r"`identify` state no plan \(model: ") as refused:
        make(rows_of(ENCODER, 1000), rows_of(CARD, 1000), lacks=["model"])
    assert "--plan PROCEDURE" in (refused.value.hint or "")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("signals", "null"),
        ("constants", "[0.5]"),
        ("constants", '{"mass": {}}'),
        ("group_by", "surface"),
        ("group_by", "[[]]"),
        ("uncertainties", '{"mass": {"u": 0.1}}'),
        ("units", "[" * 9999),
    ],
)
def test_recorded_plan_of_others_may_be_replaced(make: Make, name: str, value: str) -> None:
    path = make(rows_of(ENCODER, 1000), rows_of(CARD, 1000)).path
    add_metadata(path, {"identify": {name: value, "of another program": "{"}})
    with pytest.raises(DataError, match=f"run.mcap: its metadata `identify` .*{name}"):
        open_sweep(path)
    other = IdentifyPlan("lugre", {"angle": "encoder.angle"}, {})
    assert open_sweep(path, other).plan == other
