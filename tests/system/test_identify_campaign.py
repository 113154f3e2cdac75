"""A campaign that is run, spoilt at the rig, and identified: what was wrong is reported."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.analysis.evaluation import evaluate
from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, execute
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import parse_procedure
from rigd.sdk.shipped_files import shipped_folder
from rigd_analyses.approach_angle.evaluation import CampaignEvaluation
from rigd_analyses.approach_angle.raw.run_data import Regime

SHIPPED = shipped_folder("procedures") / "approach_angles.yaml"


def played(folder: Path, text: str, **chosen: str) -> CampaignEvaluation:
    """Run the procedure ``text`` on the shipped rig, and identify its recording."""
    rig = load_rig("angle-1")
    source = parse_procedure(text, folder / "changed.yaml")
    procedure = compile_procedure(source, rig, chosen)
    path = folder / "campaign.mcap"
    execute(RunRequest(procedure, text, rig, 1, output=path))
    found = evaluate([path])
    assert isinstance(found, CampaignEvaluation)
    return found


def spoilt_by(fault: str) -> str:
    """Return the shipped procedure with a step that spoils the rig once it is set up."""
    text = SHIPPED.read_text("utf-8")
    prompt = (
        f"    - prompt: spoil\n      text: Spoil it.\n      choices: [{fault}]\n"
        f"      answer: {fault}\n      changes: fault\n"
    )
    assert text.count("    - step: ready\n") == 1
    return text.replace("    - step: ready\n", f"{prompt}    - step: ready\n")


@pytest.mark.parametrize(
    ("fault", "codes"),
    [
        ("gauges_swapped", {"negative_torque"}),
        ("platform_pot_dead", {"pot_dead", "incomplete"}),
    ],
)
def test_fault_at_rig_is_reported_without_any_number(
    tmp_path: Path, fault: str, codes: set[str]
) -> None:
    text = spoilt_by(fault).replace("check: ask", "check: warn")
    found = played(tmp_path, text, set="clean_0", load="4 kg", voltage="5.5 V")
    assert len(found.result.runs) == 2
    for run in found.result.runs:
        assert run.excluded
        assert codes & {flag.code for flag in run.flags}, run.flags
        assert run.paper.mu != run.paper.mu
        assert run.better.mu != run.better.mu
    (only,) = found.result.sets
    assert only.maximum is None
    assert only.paper.value is None
    assert (only.paper.raw, only.paper.flagged, only.paper.used) == (2, 2, 0)


def test_unusable_first_trial_ends_run_without_operator(tmp_path: Path) -> None:
    text = spoilt_by("gauges_swapped")
    found = played(tmp_path, text, set="clean_0", load="4 kg", voltage="5.5 V")
    assert len(found.result.runs) == 1
    assert "gauge a and b are swapped" in found.result.warnings[0]


def test_trial_ended_by_interlock_has_its_reason(tmp_path: Path) -> None:
    text = spoilt_by("wheel_pot_at_end")
    found = played(tmp_path, text, set="clean_0", load="4 kg", voltage="5.5 V")
    (item,) = found.result.runs
    incomplete = next(flag for flag in item.flags if flag.code == "incomplete")
    assert "wheel_angle" in incomplete.reason, incomplete
    assert item.excluded
    assert "wheel_near_end" in found.result.warnings[0]
    assert "0 of 2 trials are complete" in found.result.warnings[0]


def test_run_that_never_slides_is_no_friction_coefficient(tmp_path: Path) -> None:
    text = SHIPPED.read_text("utf-8")
    found = played(tmp_path, text, set="coated_0", load="8 kg", voltage="4 V")
    for run in found.result.runs:
        assert run.paper.regime is Regime.ROLLING
        assert run.better.mu != run.better.mu
        assert run.better.demand == pytest.approx(run.paper.mu, abs=0.03)
        assert "no_sliding" in {flag.code for flag in run.flags}
    assert found.result.sets[0].maximum is None


def test_one_load_of_one_set_gives_its_maximum(tmp_path: Path) -> None:
    """Ten good runs: none is flagged away, and both maxima are where they were measured to be."""
    found = played(tmp_path, SHIPPED.read_text("utf-8"), set="clean_15", load="4 kg")
    assert [run.run.label for run in found.result.runs if run.excluded] == []
    (only,) = found.result.sets
    assert only.published == 0.2475
    assert only.paper.value is not None
    assert 1.03 < only.paper.value / 0.2475 < 1.25
    assert only.maximum is not None
    assert only.maximum.value == pytest.approx(0.2475, rel=0.05)
    assert only.maximum.low < 0.2475 < only.maximum.high
    for run in found.result.runs:
        on = run.run.run_on
        assert on.at_rest and on.by_travel and on.threshold_m == 0.3
        assert 0.0 < on.overshoot_s < 0.035  # a block, its latency, and the cycle: 15 ms on average
        assert 0.45 < on.final_travel_m < 0.48  # the bumper begins at 0.45 m
        assert 10.0 < on.final_turning_rad < on.turning_limit_rad
    assert [point.runs for point in found.result.slips] == [2, 2, 2, 2, 2]
    assert found.result.slips[-1].slip > found.result.slips[0].slip > 0.0
