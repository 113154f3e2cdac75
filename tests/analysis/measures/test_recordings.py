"""Measures read off a recording whose signals are known in closed form."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigd.analysis.measures import MeasureResult, Summary, measured
from rigd.analysis.measures.view import trial_columns, view_of
from rigd.model import ConfigError, DataError
from rigd.model.channels import STALE, STATUS_FIELD, Channel, Stream
from rigd.model.rows import TIME_FIELD, row_dtype
from rigd.procedure.loader import parse_procedure
from rigd.record import Attachment, Recording, RecordingWriter

START_NS = 1_790_000_000_000_000_000
AXIS = Stream(
    "axis",
    (
        Channel("position", "m"), Channel("force", "N"), Channel("heat", "K"),
        Channel("load", "N", low=0.0, high=5.0),
        Channel("load_raw", "V", low=-10.0, high=10.0, raw_of="load"),
    ),
    has_status=True,
)  # fmt: skip
FRICTION = Stream("friction", (Channel("mu", "1"),), source="derived")
RIG = """\
rig: bench
title: A bench
cycle: 1 kHz
devices: {axis: {driver: not-installed-here}}
interlocks: []
constants: {limit: {value: 30 mm, u: 1 mm}}
derived:
  half.load: {is: axis.load / 2}
  friction.mu: {is: half.load / 50 N}
"""
PROCEDURE = """\
procedure: pull
title: Pull
doc: For tests.
parameters:
  force: {{doc: Force, unit: N, default: 2 N}}
  span: {{doc: Span, unit: mm, default: 20 mm}}
  floor: {{doc: Floor, choices: [stone, pvc], default: stone}}
sweep: {{grid: {{force: [1 N, 2 N]}}}}
trial:
  steps:
    - step: rest
      for: 0.2 s
    - step: pull
      for: 0.8 s
  after:
    - step: back
      for: 0.5 s
measure:
{measure}
"""
#: A trial lasts 1.5 s: 0.2 s of rest, 0.8 s of pull, 0.5 s of the way back.
PERIOD_NS, ROWS = 1_000_000, 1500
STEPS = ((0.0, "rest"), (0.2, "pull"), (1.0, "back"))


def trial_rows(number: int, force: float) -> np.ndarray:
    """Return the rows of a trial: from 0.2 s on the position grows by 0.1 m/s."""
    rows = np.zeros(ROWS, row_dtype(AXIS))
    t = np.arange(ROWS) * 1e-3
    rows[TIME_FIELD] = START_NS + (number - 1) * ROWS * PERIOD_NS + np.arange(ROWS) * PERIOD_NS
    rows["position"] = np.where(t < 0.2, 0.0, 0.1 * (t - 0.2))
    rows["force"] = force + np.sin(2 * math.pi * 10 * t)
    rows["heat"] = 293.15 + 20 * t
    return rows


def record(
    path: Path,
    measure: str,
    trials: Sequence[tuple[int, float, bool]] = ((1, 1.0, True),),
    change: Mapping[int, Any] | None = None,
    extra: Sequence[tuple[float, str, int, Mapping[str, Any]]] = (),
    steps: Sequence[tuple[float, str]] = STEPS,
    rig: str = "bench",
    more: Mapping[str, float] | None = None,
    unit: str = "N",
    description: str = RIG,
) -> Recording:
    """Write trials (number, force, whether complete); ``change`` edits the rows of one."""
    text = PROCEDURE.format(measure=measure)
    attachments = [
        Attachment("procedure.yaml", "application/yaml", text.encode()),
        Attachment("rig.yaml", "application/yaml", description.encode()),
    ]
    with RecordingWriter.create(
        path, streams=[AXIS, FRICTION], metadata={"run": {"procedure": "pull", "rig": rig}},
        attachments=attachments, start_ns=START_NS, sync_interval_s=None,
    ) as writer:  # fmt: skip
        for place, (number, force, complete) in enumerate(trials, 1):
            begin = START_NS + (place - 1) * ROWS * PERIOD_NS
            parameters = {"force": force, **(more or {})}
            if unit != "N":
                parameters = dict(reversed(parameters.items()))
            data = {"number": number, "repeat": 1, "parameters": parameters,
                    "units": {"force": unit, "span": "m"}}  # fmt: skip
            writer.event(begin, "trial_start", number, data)
            for at_s, step in steps:
                writer.event(begin + round(at_s * 1e9), "step", number, {"name": step})
            rows = trial_rows(place, force)
            if change and place in change:
                rows = change[place](rows)
            writer.write("axis", rows)
            ratio = np.zeros(len(rows), row_dtype(FRICTION))
            ratio[TIME_FIELD], ratio["mu"] = rows[TIME_FIELD], rows["load"] / 100
            writer.write("friction", ratio)
            reason = "all steps played" if complete else "timeout of step pull"
            end = {"complete": complete, "reason": reason}
            writer.event(begin + ROWS * PERIOD_NS - 1, "trial_end", number, end)
        for at_s, kind, number, more in extra:
            writer.event(START_NS + round(at_s * 1e9), kind, number, more)
        writer.event(
            START_NS + len(trials) * ROWS * PERIOD_NS, "run_end", -1, {"state": "complete"}
        )
    return Recording.open(path)


def only(result: MeasureResult) -> Summary:
    (summary,) = result.summaries
    return summary


def value(tmp_path: Path, measure: str, **options: Any) -> float:
    reading = only(measured([record(tmp_path / "a.mcap", f"  it: {measure}", **options)])).readings[
        0
    ]
    assert reading.value is not None, reading.reason
    return reading.value


def reason(tmp_path: Path, measure: str, **options: Any) -> str:
    summary = only(measured([record(tmp_path / "a.mcap", f"  it: {measure}", **options)]))
    reading = summary.readings[0]
    assert reading.value is None
    assert summary.mean is None
    return reading.reason


@pytest.mark.parametrize(
    ("measure", "expected"),
    [
        ("{channel: axis.heat, when: axis.position > 10 mm}", 293.15 + 20 * 0.3),
        ("{channel: axis.heat, when: axis.position > 10.05 mm}", 293.15 + 20 * 0.3005),
        ("{channel: axis.position, when: 'axis.heat > 29 degC'}", 0.1 * 0.25),
        ("{channel: axis.heat, when: 'axis.position > ${span}'}", 293.15 + 20 * 0.4),
        ("{channel: axis.heat, when: 'axis.position > ${rig.limit}'}", 293.15 + 20 * 0.5),
        ("{mean: axis.force, during: pull}", 1.0),
        ("{max: axis.force, during: pull}", 2.0),
        ("{min: axis.force, during: pull}", 0.0),
        ("{peak_to_peak: axis.force, during: pull}", 2.0),
        ("{rms: axis.force, during: pull}", math.sqrt(1.5)),
        ("{std: axis.force, during: pull}", math.sqrt(0.5 * 800 / 799)),
        ("{slope: axis.position, during: pull}", 0.1),
        ("{slope: axis.heat}", 20.0),
        ("{final: axis.position, during: pull}", 0.1 * 0.799),
        ("{final: axis.position}", 0.1 * 0.799),  # not the way back
        ("{mean: axis.position, during: last 0.2 s of pull}", 0.1 * 0.6995),
        ("{mean: axis.position, during: first 0.2 s of pull}", 0.1 * 0.0995),
        ("{mean: axis.position, during: 0.1 s to 0.2 s of pull}", 0.1 * 0.1495),
        ("{duration: {from: axis.position > 10 mm, to: axis.position > 30 mm}}", 0.2),
        ("{duration: {to: axis.position > 30 mm}, during: pull}", 0.3),
        ("{duration: {to: axis.position > 30 mm}}", 0.5),
        ("{mean: axis.heat, unit: degC, during: rest}", 293.15 + 20 * 0.0995),
        ("{mean: axis.heat, during: 0.3 s to 0.4 s}", 293.15 + 20 * 0.3495),
        ("{mean: axis.heat, during: last 0.1 s}", 293.15 + 20 * 0.9495),
        (
            "{mean: axis.heat, during: {from: axis.force < 0.99 N, to: axis.position > 29.95 mm}}",
            293.15 + 20 * (0.051 + 0.499) / 2,
        ),
        (
            "{mean: axis.heat, during: {to: axis.position > 9.95 mm, of: pull}}",
            293.15 + 20 * 0.2495,
        ),
        (
            "{mean: axis.heat, during: {while: axis.position > 9.95 mm, of: first 0.2 s of pull}}",
            293.15 + 20 * 0.3495,
        ),
    ],
)
def test_measure_is_its_value_in_closed_form(tmp_path: Path, measure: str, expected: float) -> None:
    assert value(tmp_path, measure) == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_window_begins_with_third_stroke(tmp_path: Path) -> None:
    during = "{from: axis.force > 1.5 N, nth: 3, of: pull}"
    found = value(tmp_path, f"{{duration: {{to: axis.force < 1 N}}, during: {during}}}")
    assert found == pytest.approx(1 / 20 - 1 / 120, rel=1e-3)


def test_window_holds_samples_that_fulfil_it(tmp_path: Path) -> None:
    during = "{while: axis.force > 1 N, of: pull}"
    found = value(tmp_path, f"{{mean: axis.force, during: {during}}}")
    assert found == pytest.approx(1 + 2 / math.pi, rel=1e-2)


def of_heat(scale: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return what has the heat alternate by ``scale``."""

    def change(rows: np.ndarray) -> np.ndarray:
        rows["heat"] = scale * np.where(np.arange(len(rows)) % 2, 1.0, -1.0)
        return rows

    return change


def test_spread_of_extreme_samples_is_right(tmp_path: Path) -> None:
    measure, change = "{rms: axis.heat, during: pull}", {1: of_heat(1e200)}
    assert value(tmp_path, measure, change=change) == pytest.approx(1e200)


def test_statistic_beyond_all_numbers_is_not_read(tmp_path: Path) -> None:
    measure, change = "{peak_to_peak: axis.heat, during: pull}", {1: of_heat(1.7e308)}
    assert "too large to compute with" in reason(tmp_path, measure, change=change)


def loaded(load: float, raw: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return what sets the load sensor and its raw value from 0.9 s to 0.92 s."""

    def change(rows: np.ndarray) -> np.ndarray:
        rows["load"][900:920], rows["load_raw"][900:920] = load, raw
        return rows

    return change


@pytest.mark.parametrize(
    ("channel", "load", "raw", "end"),
    [
        ("axis.load", 5.0, 1.0, "axis.load at the end of its range, 5 N"),
        ("axis.load", 4.0, -10.0, "axis.load_raw at the end of its range, -10 V"),
        ("friction.mu", 5.0, 1.0, "axis.load at the end of its range, 5 N"),  # through half.load
        ("friction.mu", 4.0, 10.0, "axis.load_raw at the end of its range, 10 V"),
    ],
)
def test_saturated_sensor_gives_no_number(
    tmp_path: Path, channel: str, load: float, raw: float, end: str
) -> None:
    change = {1: loaded(load, raw)}
    for kind in ("mean", "max"):
        (folder := tmp_path / kind).mkdir()
        why = reason(folder, f"{{{kind}: {channel}, during: pull}}", change=change)
        assert why == f"20 of 800 samples have {end}"
    at = f"{{channel: {channel}, when: axis.position > 71 mm}}"
    assert reason(tmp_path, at, change=change) == f"2 of 2 samples have {end}"


def test_sensor_that_rests_at_zero_is_measured(tmp_path: Path) -> None:
    change = {1: loaded(4.9, 9.9)}  # and 0 N before and after, the lower end of its range
    assert value(tmp_path, "{max: axis.load}", change=change) == pytest.approx(4.9)
    (early := tmp_path / "early").mkdir()
    before = "{mean: friction.mu, during: first 0.5 s of pull}"
    assert value(early, before, change={1: loaded(5.0, 10.0)}) == 0.0


@pytest.mark.parametrize(
    ("measure", "words"),
    [
        ("{channel: axis.heat, when: axis.position > 5 m}", "axis.position > 5 m never came"),
        ("{channel: axis.heat, when: axis.heat > 20 K}", "holds already at the beginning"),
        ("{duration: {from: axis.position > 30 mm, to: axis.position > 10 mm}}", "holds already"),
        ("{duration: {from: axis.position > 3 m, to: axis.position > 4 m}}", "> 3 m never came"),
        ("{mean: axis.force, during: last 2 s of pull}", "lasted 0.8 s, not 2 s"),
        ("{mean: axis.force, during: 1 s to 9 s}", "the steps lasted 1 s, not 9 s"),
        (
            "{mean: axis.force, during: {from: axis.force > 1.5 N, nth: 9, of: pull}}",
            "axis.force > 1.5 N did not begin to hold 9 times",
        ),
        ("{mean: axis.force, during: {while: axis.force > 9 N}}", "no sample of axis.force in"),
        ("{mean: axis.force, during: 0.5 s to 1 s of pull}", "lasted 0.8 s, not 1 s"),
    ],
)
def test_measure_that_cannot_be_read_has_reason(tmp_path: Path, measure: str, words: str) -> None:
    assert words in reason(tmp_path, measure)


@pytest.mark.parametrize(
    ("measure", "expected"),
    [
        ("{final: axis.position, during: pull}", 0.1 * 0.399),
        ("{mean: axis.position, during: last 0.2 s of pull}", 0.1 * 0.2995),
        ("{final: axis.position}", 0.1 * 0.799),
        ("{mean: axis.position}", 0.1 * (0.1995 * 400 + 0.7495 * 100) / 700),
    ],
)
def test_wait_at_prompt_is_not_measured(tmp_path: Path, measure: str, expected: float) -> None:
    # The rig waits for the answer from 0.6 s to 0.9 s.
    steps = ((0.0, "rest"), (0.2, "pull"), (0.9, "rest"), (1.0, "back"))
    found = value(tmp_path, measure, steps=steps, extra=[(0.6, "prompt", 1, {"name": "turn"})])
    assert found == pytest.approx(expected, rel=1e-6)


def test_trial_without_steps_is_measured_whole(tmp_path: Path) -> None:
    assert value(tmp_path, "{final: axis.heat}", steps=()) == pytest.approx(293.15 + 20 * 1.499)


@pytest.mark.parametrize(
    ("measure", "steps", "words"),
    [
        ("{mean: axis.force, during: pull}", (), "no steps, so no 'pull': without 'during' all"),
        ("{mean: axis.force}", ((0.0, "other"),), "no step of the procedure was played"),
        ("{mean: axis.force, during: pull}", ((0.0, "other"),), "step 'pull' was not played"),
    ],
)
def test_steps_of_another_procedure_are_not_measured(
    tmp_path: Path, measure: str, steps: Sequence[tuple[float, str]], words: str
) -> None:
    assert words in reason(tmp_path, measure, steps=steps)


def test_each_measure_has_one_sentence_of_its_interval(tmp_path: Path) -> None:
    trials = [(1, 1.0, True), (2, 1.0, True)]
    both = "  a: {mean: axis.force, u: 1 %}\n  b: {mean: axis.heat}"
    remarks = view_of(measured([record(tmp_path / "a.mcap", both, trials)])).remarks
    about = [text for text in remarks if "95 %" in text]
    assert len(about) == 2
    assert about[0].startswith("95 % interval of the mean of a: repeatability (type A) and the")
    assert about[1].startswith("95 % interval of the mean of b: repeatability only (type A)")


def test_incomplete_trial_is_not_measured(tmp_path: Path) -> None:
    why = reason(tmp_path, "{mean: axis.force}", trials=[(1, 1.0, False)])
    assert why == "the trial is not complete: timeout of step pull"


def test_held_trial_is_not_measured(tmp_path: Path) -> None:
    held = [(0.5, "hold", 1, {"step": "pull", "phase": "held"}),
            (0.6, "hold", 1, {"step": "pull", "phase": "over"})]  # fmt: skip
    assert "held by a pause" in reason(tmp_path, "{mean: axis.force}", extra=held)


def test_sample_without_value_is_never_passed_over(tmp_path: Path) -> None:
    def spoil(rows: np.ndarray) -> np.ndarray:
        rows["force"][400:403] = np.nan
        return rows

    why = reason(tmp_path, "{max: axis.force, during: pull}", change={1: spoil})
    assert why == "3 of 800 samples of axis.force have no value"


def test_derived_sample_without_value_names_where(tmp_path: Path) -> None:
    def spoil(rows: np.ndarray) -> np.ndarray:
        rows["load"][400:403] = np.nan
        return rows

    why = reason(tmp_path, "{mean: friction.mu, during: pull}", change={1: spoil})
    assert why.startswith("3 of 800 samples of friction.mu have no value: a derived channel")
    assert "write 'hold(x, condition)' into its formula" in why


@pytest.mark.parametrize(
    ("measure", "words"),
    [
        ("{mean: axis.force, during: pull}", "1 of 800 samples of axis.force have no value"),
        ("{slope: axis.force, during: pull}", "1 of 800 samples of axis.force have no value"),
        (
            "{channel: axis.force, when: axis.position > 20.05 mm}",
            "axis.force has no value at the event",
        ),
        ("{duration: {to: axis.force > 5 N}, during: pull}", "axis.force > 5 N never came"),
    ],
)
@pytest.mark.parametrize("bad", [math.inf, -math.inf, math.nan])
def test_sample_that_is_not_finite_gives_reason(
    tmp_path: Path, measure: str, words: str, bad: float
) -> None:
    def spoil(rows: np.ndarray) -> np.ndarray:
        rows["force"][400] = bad
        return rows

    assert reason(tmp_path, measure, change={1: spoil}) == words


def test_repeated_rows_of_late_device_do_not_count(tmp_path: Path) -> None:
    def repeat(rows: np.ndarray) -> np.ndarray:
        rows["force"][500:600] = 77.0
        rows[STATUS_FIELD][500:600] = STALE
        return rows

    assert value(tmp_path, "{max: axis.force}", change={1: repeat}) == pytest.approx(2.0)


def test_trial_played_again_counts_once(tmp_path: Path) -> None:
    trials = [(1, 1.0, False), (1, 1.0, True), (2, 1.0, True)]
    summary = only(measured([record(tmp_path / "a.mcap", "  it: {mean: axis.force}", trials)]))
    assert [reading.trial for reading in summary.readings] == [1, 2]
    assert summary.count == 2


SWEPT = [(1, 1.0, True), (2, 1.0, True), (3, 2.0, True), (4, 2.0, True)]


def test_trials_with_equal_setpoints_are_one_result(tmp_path: Path) -> None:
    result = measured([record(tmp_path / "a.mcap", "  it: {mean: axis.force}", SWEPT)])
    assert [item.setpoints for item in result.summaries] == [{"force": "1 N"}, {"force": "2 N"}]
    assert [item.count for item in result.summaries] == [2, 2]
    assert [item.mean for item in result.summaries] == pytest.approx([1.0, 2.0], abs=1e-3)


def test_result_holds_parameters_all_trials_share(tmp_path: Path) -> None:
    (item,) = measured([record(tmp_path / "a.mcap", "  it: {mean: axis.force}")]).summaries
    assert (item.setpoints, item.conditions) == ({}, {"force": "1 N"})


def moved(by: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return what adds ``by`` to the force of a trial."""

    def change(rows: np.ndarray) -> np.ndarray:
        rows["force"] += by
        return rows

    return change


def test_bounds_follow_the_parameter_that_is_swept(tmp_path: Path) -> None:
    measure = '  it: {mean: axis.force}\naccept:\n  it: ["${force} - 0.1 N", "${force} + 0.1 N"]'
    change = {2: moved(0.01), 4: moved(0.01)}  # equal trials have no interval
    result = measured([record(tmp_path / "a.mcap", measure, SWEPT, change)])
    assert [item.measure.low for item in result.summaries] == pytest.approx([0.9, 1.9])
    assert result.judgement is not None
    assert result.judgement.value == "accepted"


def test_trials_of_several_recordings_are_one_result(tmp_path: Path) -> None:
    files = [record(tmp_path / f"{name}.mcap", "  it: {mean: axis.force}", change={1: moved(by)})
             for name, by in (("a", 0.0), ("b", 0.01))]  # fmt: skip
    summary = only(measured(files))
    assert [reading.recording.stem for reading in summary.readings] == ["a", "b"]
    assert "a 1" in [line.trial for line in view_of(measured(files)).trials]


def test_equal_setpoints_written_otherwise_are_one_result(tmp_path: Path) -> None:
    measure = "  it: {max: axis.force, during: pull}"
    recordings = [
        record(tmp_path / f"{unit}.mcap", measure, more={"span": 0.02}, unit=unit,
               change={1: moved(shift)})
        for unit, shift in (("N", 0.0), ("mN", 0.5))
    ]  # fmt: skip
    summary = only(measured(recordings))
    assert len(summary.readings) == 2
    assert summary.conditions == {"force": "1 N", "span": "0.02 m"}
    assert summary.point == {"force": "1", "span": "0.02"}


def derived(folder: Path, *formulas: str) -> list[Recording]:
    """Return a recording of the ratio for each formula of half.load, which it rests on."""
    text = "axis.load / 2"
    return [
        record(folder / f"{name}.mcap", "  it: {mean: friction.mu}", change={1: loaded(by, 1.0)},
               description=RIG.replace(text, formula))
        for name, by, formula in zip("ab", (4.0, 4.1), formulas, strict=True)
    ]  # fmt: skip


def test_another_formula_behind_measure_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError) as refused:
        measured(derived(tmp_path, "axis.load / 2", "axis.load / 3"))
    assert refused.value.message == (
        f"{tmp_path / 'b.mcap'} measures it otherwise than the recordings before it: half.load is "
        "'axis.load / 3', before 'axis.load / 2'"
    )


def test_formula_with_other_spaces_is_one(tmp_path: Path) -> None:
    assert only(measured(derived(tmp_path, "axis.load / 2", "axis.load/2"))).count == 2


def test_copy_of_recording_is_no_further_run(tmp_path: Path) -> None:
    files = [record(tmp_path / f"{name}.mcap", "  it: {mean: axis.force}", change={1: moved(by)})
             for name, by in (("a", 0.0), ("b", 0.01))]  # fmt: skip
    shutil.copyfile(files[0].path, copy := tmp_path / "copy.mcap")
    with pytest.raises(DataError, match=r"trial 1 of .*copy\.mcap is sample for sample .*a\.mcap"):
        measured([*files, Recording.open(copy)])


def test_copy_is_found_by_channel_of_condition(tmp_path: Path) -> None:
    measure = "  it: {duration: {to: axis.position > 30 mm}}"
    files = [record(tmp_path / f"{name}.mcap", measure) for name in "ab"]
    with pytest.raises(DataError, match="sample for sample"):
        measured(files)


def test_one_file_by_two_paths_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    absolute = record(tmp_path / "a.mcap", "  it: {mean: axis.force}")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DataError, match=r"^a\.mcap and /.*/a\.mcap are one file"):
        measured([absolute, Recording.open(Path("a.mcap"))])


def test_recordings_of_two_rigs_are_refused(tmp_path: Path) -> None:
    files = [record(tmp_path / f"{rig}.mcap", "  it: {mean: axis.force}", change={1: moved(by)},
                    rig=rig) for rig, by in (("bench", 0.0), ("tower", 0.01))]  # fmt: skip
    with pytest.raises(DataError) as caught:
        measured(files)
    first, second = (file.path for file in files)
    assert caught.value.message == f"{second} is of the rig 'tower', {first} of the rig 'bench'"


def test_recordings_that_measure_otherwise_are_refused(tmp_path: Path) -> None:
    files = [record(tmp_path / f"{kind}.mcap", f"  it: {{{kind}: axis.force}}") for kind in
             ("mean", "max")]  # fmt: skip
    with pytest.raises(DataError, match="measures otherwise") as caught:
        measured(files)
    assert caught.value.hint == "measure them one by one, or give --plan for all"


def test_another_procedure_measures_old_recording(tmp_path: Path) -> None:
    recording = record(tmp_path / "a.mcap", "  it: {mean: axis.force}")
    other = PROCEDURE.format(measure="  top: {max: axis.position, unit: mm}")
    result = measured([recording], parse_procedure(other, Path("new.yaml")))
    assert only(result).mean == pytest.approx(0.1 * 0.799)
    assert view_of(result).lines[0].mean == "79.9"


def test_channel_not_recorded_is_named_with_place(tmp_path: Path) -> None:
    recording = record(tmp_path / "a.mcap", "  it: {mean: axis.force}")
    other = PROCEDURE.format(measure="  top: {max: axis.positon}")
    with pytest.raises(ConfigError, match=r"new.yaml:19:14: .*no channel 'axis.positon'"):
        measured([recording], parse_procedure(other, Path("new.yaml")))


def test_recording_without_measures_is_refused(tmp_path: Path) -> None:
    recording = record(tmp_path / "a.mcap", "  it: {mean: axis.force}")
    without = PROCEDURE.format(measure="").replace("measure:\n", "")
    with pytest.raises(DataError, match="measures nothing"):
        measured([recording], parse_procedure(without, Path("new.yaml")))


def test_temperature_is_in_celsius_its_spread_kelvin(tmp_path: Path) -> None:
    measure = "  hot: {max: axis.heat, unit: degC, during: rest}\naccept: {hot: [20 degC, 80 °F]}"
    trials = [(1, 1.0, True), (2, 1.0, True)]

    def warm(rows: np.ndarray) -> np.ndarray:
        rows["heat"] += 2.0
        return rows

    view = view_of(measured([record(tmp_path / "a.mcap", measure, trials, {2: warm})]))
    (line,) = view.lines
    assert line.name == "hot [degC]"
    assert line.mean == "25"
    assert line.std == "1.4"
    assert line.accept == "20 to 26.6667"
    assert line.verdict == "not decided"


def test_unread_trial_has_no_value_in_export(tmp_path: Path) -> None:
    measure = "  it: {channel: axis.heat, when: axis.position > 10 mm}"

    def still(rows: np.ndarray) -> np.ndarray:
        rows["position"] = 0.0
        return rows

    trials = [(1, 1.0, True), (2, 1.0, True)]
    result = measured([record(tmp_path / "a.mcap", measure, trials, {2: still})])
    unit, values = trial_columns(result)["it"]
    assert (unit, list(values)) == ("K", [1])
    view = view_of(result)
    assert view.trials[1].cells == ("–",)
    assert "it: axis.position > 0.01 m never came (trial 2)" in view.remarks
