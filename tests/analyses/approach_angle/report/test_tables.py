"""The tables of a campaign as text: what stands first, and the notes beside a number."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from rigd_analyses.approach_angle.better.run import no_numbers
from rigd_analyses.approach_angle.paper import PaperRun
from rigd_analyses.approach_angle.raw.run_data import AngleRun, Coefficient, Flag, Regime, Severity
from rigd_analyses.approach_angle.report.opening import campaign_opening
from rigd_analyses.approach_angle.report.tables import flagged_rows, label, set_rows
from rigd_analyses.approach_angle.result import (
    CampaignResult,
    MeasuredCoefficient,
    PaperMaximum,
    SetResult,
)
from rigd_analyses.approach_angle.run_result import RunResult


def flagged(*flags: Flag) -> RunResult:
    """Return a run of which nothing is known but its flags."""
    none, nan = np.empty(0), math.nan
    run = AngleRun("", "clean_0", 0.0, 4.0, 10.0, 1, none, none, none, none, none, nan, nan)
    paper = PaperRun(nan, nan, nan, nan, nan, nan, nan, nan, nan, None, flags)
    return RunResult(run, paper, no_numbers(flags), flags)


def campaign(runs: Sequence[RunResult] = (), sets: Sequence[SetResult] = ()) -> CampaignResult:
    return CampaignResult(tuple(runs), tuple(sets), {}, "", ())


def test_excluding_flags_come_first_most_frequent_first() -> None:
    note = Flag("a_note", "Remarkable.", Severity.NOTE)
    rare, often = Flag("b_rare", "Dead."), Flag("c_often", "Swapped.")
    runs = [flagged(note, often), flagged(note, often), flagged(note, rare)]
    rows = flagged_rows(campaign(runs))
    assert [(row.code, row.count, row.excluded) for row in rows] == [
        ("c_often", 2, True), ("b_rare", 1, True), ("a_note", 3, False),
    ]  # fmt: skip
    assert rows[0].reasons == ("Swapped.", "Swapped.")


@pytest.mark.parametrize(
    ("regime", "told"),
    [(Regime.SLIDING, ""), (Regime.ROLLING, "rolling"), (Regime.MIXED, "mixed"), (None, "")],
)
def test_paper_maximum_of_run_without_sliding_is_marked(regime: Regime | None, told: str) -> None:
    value = None if regime is None else 0.1868
    paper = PaperMaximum(value, value, "4 kg, 10 V", regime, raw=2, flagged=0, used=2)
    found = SetResult("clean_0", 0.0, "clean", None, paper, None, None, None, None, None, 0, None)
    (row,) = set_rows(campaign(sets=[found]))
    assert row.paper_regime == told
    assert row.paper == ("–" if value is None else "0.1868")
    assert (row.maximum, row.usable, row.resultant, row.deviation) == ("–", "–", "–", "")


@pytest.mark.parametrize(("wheel", "told"), [("clean", "clean, 30°"), ("", "30°")])
def test_set_is_named_by_angle_and_known_wheel(wheel: str, told: str) -> None:
    paper = PaperMaximum(None, None, "", None, raw=0, flagged=0, used=0)
    alpha = math.radians(30.0)
    assert told == label(
        SetResult("a", alpha, wheel, None, paper, None, None, None, None, None, 0, None)
    )


def test_opening_leaves_out_maxima_without_sliding() -> None:
    rolled = PaperMaximum(0.19, 0.19, "4 kg, 10 V", Regime.ROLLING, raw=2, flagged=1, used=1)
    slid = PaperMaximum(0.19, 0.19, "4 kg, 10 V", Regime.SLIDING, raw=2, flagged=0, used=2)
    known = MeasuredCoefficient(0.2, 0.002, Coefficient.ROLLING)
    sets = [
        SetResult("clean_0", 0.0, "clean", None, slid, None, known, None, None, None, 0, None),
        SetResult("clean_15", 0.3, "clean", None, rolled, None, None, None, None, None, 0, None),
    ]
    opening = campaign_opening(campaign([flagged(Flag("dead", "Dead."))], sets))
    assert "the maximum of F_r/N of clean_0 by the corrected method (±2.0 %" in opening.usable
    assert "a maximum of clean_15" in opening.not_usable
    assert "paper's method of clean_15" in opening.not_usable
    assert "1 of 1 runs, left out" in opening.not_usable


def test_campaign_without_runs_has_nothing_usable() -> None:
    opening = campaign_opening(campaign())
    assert opening.sentences == ("Usable: no maximum.", "Not usable: nothing that was recorded.")
