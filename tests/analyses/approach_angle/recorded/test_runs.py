"""A trial of a recording as the raw run that was recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.approach_angle.recording import SIGNALS, Recorded

from rigd.analysis.recordings.source import open_sweep
from rigd.model.errors import DataError
from rigd.record import TrialInfo
from rigd_analyses.approach_angle.raw.run_data import AngleRun, Severity
from rigd_analyses.approach_angle.raw.runs import find_signals, read_run, telling_attempts

Record = Callable[..., Path]


def read(path: Path, index: int = 0) -> AngleRun:
    sweep = open_sweep(path)
    trial = telling_attempts(sweep.info.trials)[index]
    return read_run(sweep, trial, find_signals(sweep))


def test_samples_are_those_recorded_timed_from_command(
    campaign: Sequence[Recorded], record: Record
) -> None:
    simulated = campaign[7].run
    run = read(record(campaign[:8]), index=7)
    assert np.array_equal(run.gauge_a_v, simulated.gauge_a_v)
    assert np.array_equal(run.gauge_b_v, simulated.gauge_b_v)
    assert np.array_equal(run.wheel_v, simulated.wheel_v)
    assert np.array_equal(run.platform_v, simulated.platform_v)
    assert run.t_s == pytest.approx(simulated.t_s, abs=1e-6)
    # The relay's rows are 1 ms apart; the stop is the first of them that commands it to open.
    assert simulated.stop_s <= run.stop_s < simulated.stop_s + 1.1e-3
    assert (run.set_name, run.announced_load_kg, run.voltage_v, run.repeat) == (
        "clean_15", 4.0, 7.0, 2,
    )  # fmt: skip
    assert run.label == "clean_15, 4 kg, 7 V, repeat 2"
    assert run.flags == ()


def test_time_is_the_even_time_of_the_card(campaign: Sequence[Recorded], record: Record) -> None:
    steps = np.diff(read(record(campaign[:1])).t_s)
    assert np.ptp(steps) < 1e-8  # rigd's own moves by 20 µs from block to block


def test_load_is_last_settled_load_before_run(campaign: Sequence[Recorded], record: Record) -> None:
    run = read(record(campaign[:1]))
    assert run.load_n == pytest.approx(campaign[0].run.scale_kg * 9.81)
    assert run.load_stable


def test_scale_never_at_rest_gives_no_load(campaign: Sequence[Recorded], record: Record) -> None:
    run = read(record([replace(campaign[0], stable=False)]))
    assert np.isnan(run.load_n)
    assert not run.load_stable


def test_rows_that_are_not_new_are_not_taken(campaign: Sequence[Recorded], record: Record) -> None:
    """What is missing then shows as a gap in the times; see missing_samples."""
    found = campaign[0]
    run = read(record([replace(found, stale=True)]))
    assert np.array_equal(run.gauge_a_v, np.delete(found.run.gauge_a_v, 500))
    assert run.load_n == pytest.approx(found.run.scale_kg * 9.81)


def test_continuous_recording_is_cut_to_the_drive(
    campaign: Sequence[Recorded], record: Record
) -> None:
    run = campaign[0].run
    before_s = np.arange(-1.2, run.t_s[0] - 1e-6, 1 / 9600)
    longer: dict[str, Any] = {"t_s": np.concatenate([before_s, run.t_s])}
    for name in ("gauge_a_v", "gauge_b_v", "wheel_v", "platform_v"):
        longer[name] = np.pad(getattr(run, name), (len(before_s), 0))
    taken = read(record([replace(campaign[0], run=replace(run, **longer))]))
    assert taken.t_s[0] == pytest.approx(-0.5, abs=1e-3)
    assert taken.t_s[-1] == pytest.approx(run.t_s[-1], abs=1e-3)


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        (
            {"complete": False, "reason": "drive: not within 1.5 s"},
            "incomplete",
            "not within 1.5 s",
        ),
        ({"driven": False}, "not_driven", "never commanded to close"),
        ({"stopped": False}, "no_stop", "not commanded to open"),
        ({"rails": 0b100}, "at_rail", "wheel_angle in 10 of"),
        ({"again": True}, "driven_twice", "commanded to close 2 times"),
        ({"card_s": lambda t_s: 0.5 * t_s}, "clocks_disagree", "another rate"),
        ({"card_s": lambda t_s: t_s + (t_s > 0.5)}, "clocks_disagree", "samples were lost"),
        ({"card_s": lambda t_s: np.full(len(t_s), np.nan)}, "clocks_disagree", "or no number"),
    ],
)
def test_objection_in_recording_becomes_flag(
    campaign: Sequence[Recorded], record: Record, change: dict[str, Any], code: str, words: str
) -> None:
    run = read(record([replace(campaign[0], **change)]))
    flag = next(flag for flag in run.flags if flag.code == code)
    assert words in flag.reason
    assert flag.severity is Severity.EXCLUDED


@pytest.mark.parametrize("rows", [(1000, 1009), (-20, None)])
def test_spike_or_end_behind_stop_excludes_nothing(
    campaign: Sequence[Recorded], record: Record, rows: tuple[int, int | None]
) -> None:
    item = campaign[0]
    assert item.run.t_s[-20] > item.run.stop_s
    run = read(record([replace(item, rails=0b100, rail_rows=rows)]))
    assert run.flags == ()


def test_angle_and_load_as_answered_count(campaign: Sequence[Recorded], record: Record) -> None:
    mounted = {"name": "mount_angle", "changes": "angle", "planned": 0.0, "answer": 0.01}
    loaded = {"name": "put_on_weights", "changes": "load", "planned": 4.0, "answer": 4.1}
    refused = {**mounted, "answer": 0.02}
    trials = [replace(campaign[0], answers=(refused, mounted, loaded)), campaign[1]]
    path = record(trials)
    for index in (0, 1):  # what was mounted stays
        run = read(path, index)
        assert (run.alpha_rad, run.announced_load_kg, run.planned_load_kg) == (0.01, 4.1, 4.0)
        (flag,) = run.flags
        assert flag.severity is Severity.NOTE
        assert "load 4.1 kg (planned 4 kg)" in flag.reason
        assert "angle 0.572958 deg (planned 0 deg)" in flag.reason


def test_wheel_is_the_answer_to_the_prompt(campaign: Sequence[Recorded], record: Record) -> None:
    fitted = {"name": "fit_wheel", "changes": "wheel", "planned": "clean", "answer": "worn"}
    path = record([campaign[0], replace(campaign[1], answers=(fitted,))])
    assert [read(path, index).wheel for index in (0, 1)] == ["clean", "worn"]


def test_last_complete_attempt_at_a_trial_counts() -> None:
    def attempt(number: int, start_ns: int, *, complete: bool) -> TrialInfo:
        return TrialInfo(number, start_ns, complete=complete)

    attempts = [
        attempt(2, 0, complete=False),
        attempt(1, 1, complete=True),
        attempt(2, 2, complete=True),
        attempt(1, 3, complete=False),
        attempt(3, 4, complete=False),
        attempt(3, 5, complete=False),
    ]
    assert [item.start_ns for item in telling_attempts(attempts)] == [1, 2, 5]


def test_signals_of_two_cards_are_refused(campaign: Sequence[Recorded], record: Record) -> None:
    path = record(campaign[:1], signals={**SIGNALS, "gauge_b": "scale.mass"})
    with pytest.raises(DataError, match=r"stand in several streams \(daq, scale\)"):
        read(path)


def test_a_relay_without_its_command_is_refused(
    campaign: Sequence[Recorded], record: Record
) -> None:
    path = record(campaign[:1], signals={**SIGNALS, "relay": "scale.mass"})
    with pytest.raises(DataError, match="'scale' has no channel 'mass_setpoint'"):
        read(path)
