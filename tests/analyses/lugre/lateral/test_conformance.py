"""The analysis of lateral sweeps keeps what every analysis promises, and its report its numbers."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from support.lugre.lateral_bench import DRY, VISCOUS, LateralBench

from rigd.analysis import Options
from rigd.analysis.check import Case, SimulatedTrial, examine_analysis, write_case
from rigd.analysis.evaluation import evaluate_sweeps
from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.recordings.source import open_sweep
from rigd.analysis.terminal import TerminalTable
from rigd_analyses.lugre.lateral.analysis import LateralAnalysis
from rigd_analyses.lugre.lateral.constants import LateralTrial
from rigd_analyses.lugre.trials.known_constants import RigConstants


@pytest.fixture(scope="module")
def case(trials: list[LateralTrial], lateral_bench: LateralBench, rig: RigConstants) -> Case:
    return case_of(trials, lateral_bench, rig)


def case_of(trials: list[LateralTrial], lateral_bench: LateralBench, rig: RigConstants) -> Case:
    simulated = [
        SimulatedTrial(
            item.trial.t_s,
            {
                "wheel_angle": item.trial.wheel_angle_rad,
                "carriage_position": item.trial.carriage_position_m,
                "acceleration": item.trial.acceleration_m_s2,
                "motor_current": item.trial.motor_current_a,
                "lateral_speed": item.speed_m_s,
            },
            {
                "current": item.trial.current_a,
                "lateral_speed": item.asked_m_s,
                "direction": item.trial.label[-10:].strip(),
            },
        )
        for item in trials
    ]
    drive = (
        "mass", "wheel_radius", "guide_friction", "rolling_resistance", "gravity",
        "torque_constant", "gear_ratio", "gear_efficiency", "no_load_torque", "no_load_viscous",
        "motor_inertia", "wheel_inertia", "bearing_torque",
    )  # fmt: skip
    lateral = lateral_bench.constants
    constants = {name: getattr(rig, name).value for name in drive} | {
        "roller_transitions": rig.roller_transitions,
        "guide_lever": lateral.lever.value,
        "guide_height": lateral.height.value,
        "guide_half_span": lateral.half_span.value,
        "row_distance": lateral.row_distance.value,
        "mass_offset": lateral.mass_offset.value,
        "bearing_spacing": lateral.bearing_spacing,
        "bearing_overhang": lateral.bearing_overhang,
    }
    return Case(simulated, constants, {"mu_R_dry": DRY, "mu_R_vis": VISCOUS})


def test_lateral_analysis_conforms(case: Case, tmp_path: Path) -> None:
    assert examine_analysis(LateralAnalysis, [case], tmp_path).findings == ()


def test_report_json_and_table_agree(case: Case, tmp_path: Path) -> None:
    sweep = open_sweep(write_case(tmp_path / "case.mcap", LateralAnalysis, case))
    evaluation = evaluate_sweeps(LateralAnalysis, [sweep], Options(), lambda _: None)
    found = json.loads(json.dumps(evaluation.to_json(), allow_nan=False))
    errors = found["speed_error"]
    assert len(errors["trials"]) == 8
    assert errors["together"]["all"]["ratio"] > 10.0
    page = evaluation.report()
    assert page.count("<svg") > 8
    assert 0 < page.index("<strong>Not usable:</strong>") < page.index('<section id="speeds">')
    assert found["coupling"].split(";")[0] in page
    tables = [item for item in evaluation.terminal_report() if isinstance(item, TerminalTable)]
    _, each, together = tables
    assert len(each.rows) == 4 and len(together.rows) == 3
    ratio = f"{errors['together']['all']['ratio']:.1f}"
    assert ratio in together.rows[-1].cells and ratio in page
    for row in each.rows:
        for text in row.cells:
            assert text in page


def test_group_that_cannot_answer_stops_no_other(
    fast: list[LateralTrial], lateral_bench: LateralBench, rig: RigConstants, tmp_path: Path
) -> None:
    still = [replace(item, speed_m_s=0.0 * item.speed_m_s) for item in fast]
    sweeps = [
        open_sweep(write_case(tmp_path / name, LateralAnalysis, case_of(part, lateral_bench, rig)))
        for name, part in (("still.mcap", still), ("moving.mcap", fast))
    ]
    found = evaluate_sweeps(LateralAnalysis, sweeps, Options(by_recording=True), lambda _: None)
    assert isinstance(found, ParameterEvaluation)
    assert [paths[0].name for paths in found.recordings] == ["moving.mcap"]
    (refused,) = found.refused
    assert "still.mcap" in refused.sentence and "no trial moves sideways" in refused.reason
    assert not found.fits
    assert "not identified" in str(found.terminal_report())
