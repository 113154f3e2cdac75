"""Makes the two sentences that a campaign's report opens with."""

from __future__ import annotations

from rigd.analysis.report import Opening
from rigd.analysis.report.opening import joined, listed
from rigd.analysis.report.rounding import number, places_for
from rigd_analyses.approach_angle.raw.run_data import Regime
from rigd_analyses.approach_angle.result import CampaignResult, SetResult


def campaign_opening(result: CampaignResult) -> Opening:
    """Return which maxima of ``result`` may be used as limits of friction, and which may not."""
    known = [item for item in result.sets if item.maximum is not None]
    unknown = [item.name for item in result.sets if item.maximum is None]
    rolled = [item.name for item in result.sets if _rolled(item)]
    left_out = sum(run.excluded for run in result.runs)
    return Opening(
        joined([_usable(known, result)] if known else [], "no maximum"),
        joined(
            [
                f"a maximum of {listed(unknown)}: no wheel slid, or no run could be used"
                if unknown
                else "",
                f"the maximum by the paper's method of {listed(rolled)}: in that run the wheel did "
                "not slide, so it is no limit of friction"
                if rolled
                else "",
                f"{left_out} of {len(result.runs)} runs, left out with their reasons"
                if left_out
                else "",
            ],
            "nothing that was recorded",
        ),
    )


def _usable(known: list[SetResult], result: CampaignResult) -> str:
    shares = [100.0 * m.expanded / m.value for s in known if (m := s.maximum) is not None]
    ends = [number(share, places_for(share)) for share in (min(shares), max(shares))]
    within = f"±{ends[0]} %" if ends[0] == ends[1] else f"±{ends[0]} to {ends[1]} %"
    used = sum(not run.excluded for run in result.runs)
    return (
        f"the maximum of F_r/N of {listed([item.name for item in known])} by the corrected method "
        f"({within}, k = 2), from {used} of {len(result.runs)} runs"
    )


def _rolled(item: SetResult) -> bool:
    return item.paper.regime not in (None, Regime.SLIDING)
