"""Slip over the angle and the summary of stops: means, intervals, and what is not known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from rigd_analyses.approach_angle.better.run import no_numbers
from rigd_analyses.approach_angle.campaign.slip_over_angle import slip_over_angle
from rigd_analyses.approach_angle.campaign.stops import stops_of
from rigd_analyses.approach_angle.paper import PaperRun
from rigd_analyses.approach_angle.raw.run_data import AngleRun, Flag, Regime, RunOn
from rigd_analyses.approach_angle.report.tables import slip_rows, stop_sentences
from rigd_analyses.approach_angle.result import CampaignResult
from rigd_analyses.approach_angle.run_result import RunResult

STOP = RunOn(
    stop_travel_m=0.32, stop_speed_m_s=2.0, threshold_m=0.3, final_travel_m=0.46,
    final_turning_rad=44.0, turning_limit_rad=50.0, at_rest=True,
)  # fmt: skip


def run(
    load_kg: float, slip: float, u: float = 0.0, *, flags: tuple[Flag, ...] = (),
    regime: Regime = Regime.SLIDING, on: RunOn | None = None,
) -> RunResult:  # fmt: skip
    """Return a run of which only its slip and its stop are known."""
    none, nan = np.empty(0), math.nan
    raw = AngleRun(
        "", "clean_45", 0.25 * math.pi, load_kg, 10.0, 1, none, none, none, none, none, nan, nan,
        wheel="clean", run_on=on or RunOn(),
    )  # fmt: skip
    paper = PaperRun(nan, nan, nan, nan, nan, nan, nan, nan, nan, None, flags)
    better = replace(no_numbers(()), slip_corrected=slip, slip_corrected_u=u, regime=regime)
    return RunResult(raw, paper, better, flags)


def result_of(runs: Sequence[RunResult]) -> CampaignResult:
    return CampaignResult(tuple(runs), (), {}, "", (), slips=slip_over_angle(runs))


def test_each_load_counts_once_in_slip() -> None:
    (point,) = slip_over_angle([run(4.0, 1.0), run(4.0, 1.0), run(4.0, 1.0), run(8.0, 0.5)])
    assert point.slip == 0.75
    assert (point.lowest_load, point.highest_load, point.runs) == (0.5, 1.0, 4)
    assert point.loads_kg == (4.0, 8.0)


def test_slip_interval_holds_spread_and_shared_part() -> None:
    pairs = [run(4.0, 0.9, 0.01), run(4.0, 1.1, 0.01), run(8.0, 0.4, 0.01), run(8.0, 0.6, 0.01)]
    (point,) = slip_over_angle(pairs)
    # s = 0.141 of either load; its mean of means has s/2, and t(2) = 4.303.
    assert point.expanded == pytest.approx(math.hypot(4.303 * 0.1414 / 2.0, 0.02), rel=1e-3)


def test_slip_without_equal_runs_has_no_interval() -> None:
    (point,) = slip_over_angle([run(4.0, 1.0), run(8.0, 0.5)])
    assert math.isnan(point.expanded)


def test_run_left_out_enters_no_slip() -> None:
    (point,) = slip_over_angle([run(4.0, 1.0), run(4.0, 9.0, flags=(Flag("rubbing", "Bad."),))])
    assert point.slip == 1.0


def test_slips_without_sets_make_no_rows() -> None:
    assert slip_rows(result_of([run(4.0, 1.0)])) == ()
    assert slip_rows(result_of([])) == ()


def test_overshoot_counts_only_runs_stopped_by_travel() -> None:
    by_wheel = replace(STOP, stop_travel_m=0.2)
    stops = stops_of([STOP, by_wheel, RunOn()])
    assert stops.overshoot_m == pytest.approx([0.02])
    assert stops.overshoot_s == pytest.approx([0.01])
    assert stops.final_travel_m.size == 2
    assert (stops.unrested, stops.beyond) == (0, ())


def test_what_stopped_a_run_is_null_if_unknown() -> None:
    by_wheel = replace(STOP, stop_travel_m=0.2)
    told = [item.shape()["stopped_by"] for item in (STOP, by_wheel, RunOn())]
    assert told == ["travel", "other", None]


def test_wheel_beyond_its_limit_is_counted() -> None:
    stops = stops_of([STOP, replace(STOP, final_turning_rad=56.0, at_rest=False)])
    assert stops.beyond == (56.0,)
    assert (stops.limit_rad, stops.unrested) == (50.0, 1)


def test_stops_are_told_only_if_recorded() -> None:
    assert stop_sentences(result_of([run(4.0, 1.0)])) == ()
    told = " ".join(stop_sentences(result_of([run(4.0, 1.0, on=STOP)])))
    assert "10.0 ms behind the threshold" in told
    assert "0.460 m" in told and "44.0 rad" in told
