"""The tables of a campaign as text: what stands first, and what is said beside a number."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from rigd_analyses.approach_angle.better.run import no_numbers
from rigd_analyses.approach_angle.data import AngleRun, Flag, Regime, Severity
from rigd_analyses.approach_angle.paper import PaperRun
from rigd_analyses.approach_angle.report.tables import flagged_rows, label, set_rows
from rigd_analyses.approach_angle.result import CampaignResult, PaperMaximum, RunResult, SetResult


def flagged(*flags: Flag) -> RunResult:
    """Return a run of which nothing is known but its flags."""
    none, nan = np.empty(0), math.nan
    run = AngleRun("", "clean_0", 0.0, 4.0, 10.0, 1, none, none, none, none, none, nan, nan)
    paper = PaperRun(nan, nan, nan, nan, nan, nan, nan, nan, nan, None, flags)
    return RunResult(run, paper, no_numbers(flags), flags)


def campaign(runs: Sequence[RunResult] = (), sets: Sequence[SetResult] = ()) -> CampaignResult:
    return CampaignResult(tuple(runs), tuple(sets), {}, "", ())


def test_what_leaves_runs_out_stands_first_and_of_that_the_most_frequent() -> None:
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
def test_a_maximum_of_the_paper_from_a_run_that_did_not_slide_says_so(
    regime: Regime | None, told: str
) -> None:
    value = None if regime is None else 0.1868
    paper = PaperMaximum(value, value, "4 kg, 10 V", regime, raw=2, flagged=0, used=2)
    found = SetResult("clean_0", 0.0, "clean", None, paper, None, None, None, None, None, 0, None)
    (row,) = set_rows(campaign(sets=[found]))
    assert row.paper_regime == told
    assert row.paper == ("–" if value is None else "0.1868")
    assert (row.maximum, row.usable, row.resultant, row.deviation) == ("–", "–", "–", "")


@pytest.mark.parametrize(("wheel", "told"), [("clean", "clean, 30°"), ("", "30°")])
def test_a_set_is_called_by_its_angle_and_by_its_wheel_where_that_is_known(
    wheel: str, told: str
) -> None:
    paper = PaperMaximum(None, None, "", None, raw=0, flagged=0, used=0)
    alpha = math.radians(30.0)
    assert told == label(
        SetResult("a", alpha, wheel, None, paper, None, None, None, None, None, 0, None)
    )
