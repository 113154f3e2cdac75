"""The rollers' friction from trials of an independent simulator: right, or no number."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.lugre.lateral_bench import DRY, VISCOUS, LateralBench

from rigd.analysis import DataError
from rigd.analysis.output_error.augmented_system import own_parameters
from rigd.analysis.result import FitOutcome, Meaning, Verdict
from rigd_analyses.lugre.lateral.constants import LateralConstants, LateralTrial
from rigd_analyses.lugre.lateral.coupling import LiftedRows
from rigd_analyses.lugre.lateral.extensions import candidates
from rigd_analyses.lugre.lateral.family import LateralIdentification, find_lateral
from rigd_analyses.lugre.lateral.result import LateralResult, in_words, result
from rigd_analyses.lugre.trials.known_constants import Known, RigConstants

Trials = list[LateralTrial]
SPEEDS_M_S, CURRENTS_A = (0.2, 0.65), (0.6, 1.2)
FORCE = "a force on the carriage that depends on the lateral speed"


@pytest.fixture(scope="module")
def found(trials: Trials, lateral_bench: LateralBench, rig: RigConstants) -> LateralIdentification:
    return find_lateral(trials, rig, lateral_bench.constants)


@pytest.fixture(scope="module")
def lateral(found: LateralIdentification) -> LateralResult:
    return result(found)


def test_intervals_hold_the_truth(lateral: LateralResult) -> None:
    assert lateral.gate is not None
    assert lateral.gate.outcome is not FitOutcome.MISFIT
    truth = {"mu_R_dry": DRY, "mu_R_vis": VISCOUS}
    truth |= {f"mu_R({v:.2f} m/s)": DRY + VISCOUS * v for v in (0.2, 0.65)}
    for name, value in truth.items():
        entry = lateral.parameter(name)
        assert entry.low is not None and entry.high is not None, name
        assert entry.low <= value <= entry.high, name
        assert entry.high - entry.low < 0.5 * value, name


def test_tests_of_the_coupling_are_in_the_budget(lateral: LateralResult) -> None:
    assert lateral.alarms["constants of the coupling"] == 0.019
    assert lateral.false_alarm == pytest.approx(0.029)


def test_friction_curve_holds_the_truth(lateral: LateralResult) -> None:
    true = DRY + VISCOUS * lateral.curve.x
    assert lateral.curve.x.size > 0
    assert np.all((lateral.curve.low <= true) & (true <= lateral.curve.high))


def test_including_the_force_explains_the_speed(lateral: LateralResult) -> None:
    groups = {item.name: item for item in lateral.together}
    assert set(groups) == {"positive", "negative", "all"}
    for item in groups.values():
        assert item.ratio >= 10.0
    # With G > 0 the guide carries less: the carriage is faster than the model that ignores it.
    assert groups["positive"].error_ignored_m_s > 0.01
    assert groups["negative"].error_ignored_m_s < -0.01


def test_cells_stand_beside_the_published_ones(lateral: LateralResult) -> None:
    cells = {(c.current_a, c.lateral_speed_m_s): c for c in lateral.cells}
    assert len(cells) == 8
    cell = cells[0.6, -0.65]
    assert cell.published is not None
    assert (cell.published.ignored_m_s, cell.published.included_m_s) == (0.057, 0.047)
    assert cell.ignored_m_s > 0.02 > 0.002 > cell.included_m_s


def test_turned_lateral_speed_is_named(
    fast: Trials, lateral_bench: LateralBench, rig: RigConstants
) -> None:
    turned = [replace(item, speed_m_s=-item.speed_m_s) for item in fast]
    found = find_lateral(turned, rig, lateral_bench.constants)
    shown = result(found)
    assert found.gate.outcome is FitOutcome.MISFIT
    assert "sign would have to be turned: encoder or belt direction" in found.gate.sentence
    assert all(entry.quoted is None for entry in (*shown.parameters, *shown.derived))
    errors = {item.name: item.error_ignored_m_s for item in shown.together}
    assert errors["positive"] < -0.01 and errors["negative"] > 0.01


def test_lever_on_the_other_side_is_named(
    fast: Trials, lateral_bench: LateralBench, rig: RigConstants
) -> None:
    constants = replace(lateral_bench.constants, lever=Known(-0.012, 6e-4))
    found = find_lateral(fast, rig, constants)
    assert found.gate.outcome is FitOutcome.MISFIT
    assert "guide_lever (d - e) of the other sign" in found.gate.sentence


def test_half_the_lever_is_named(lateral_bench: LateralBench, rig: RigConstants) -> None:
    constants = replace(lateral_bench.constants, lever=Known(0.006, 6e-4))
    trials = lateral_bench.sweep(2, (0.2, 0.65), (0.9, 1.5))
    found = find_lateral(trials, rig, constants)
    assert found.whole.converged
    assert found.gate.outcome is FitOutcome.MISFIT
    assert "lever d - e of the guide" in found.gate.sentence
    (strained,) = found.gate.explanations  # rollers that rub unevenly explain as much
    assert "lever d - e of the guide" in (strained.name, *strained.others)


def test_stated_friction_contradicts_a_wrong_lever(
    trials: Trials, lateral_bench: LateralBench, rig: RigConstants
) -> None:
    constants = replace(
        lateral_bench.constants, lever=Known(0.018, 6e-4), dry=Known(DRY, 0.05 * DRY),
        viscous=Known(VISCOUS, 0.05 * VISCOUS),
    )  # fmt: skip
    found = find_lateral(trials, rig, constants)
    assert found.gate.outcome is FitOutcome.MISFIT
    lever = found.gate.explanations[0]
    assert lever.name == "lever d - e of the guide"
    assert lever.size == pytest.approx(0.012, abs=2.0 * lever.sd)


def test_force_that_follows_the_lateral_speed_is_tried(found: LateralIdentification) -> None:
    tried = candidates(found.system, own_parameters(found.whole))
    (force,) = [item for item in tried if item.name.startswith(FORCE)]
    assert force.meaning is Meaning.LAW
    # Of a trial's speed and of its opposite: other outputs.
    columns = force.columns()
    speeds = [item.lateral_speed_m_s for item in found.cells]
    ends = {v: part[-1, 1] for v, part in zip(speeds, columns, strict=True)}
    assert not np.allclose(ends[0.65], ends[-0.65], rtol=0.2)


def test_lifted_rows_that_do_not_rub_are_recognised(rig: RigConstants) -> None:
    bench = LateralBench(physical=True)
    found = find_lateral(bench.sweep(3, (0.2, 0.65), (0.6, 1.2)), rig, bench.constants)
    assert found.system.rows is LiftedRows.PHYSICAL or not found.rows_known
    shown = result(found)
    for name, value in (("mu_R_dry", DRY), ("mu_R_vis", VISCOUS)):
        entry = shown.parameter(name)
        assert entry.low is None or entry.low <= value
        assert entry.high is None or value <= entry.high


def test_one_speed_gives_friction_at_that_speed(
    lateral_bench: LateralBench, rig: RigConstants
) -> None:
    trials = lateral_bench.sweep(4, (0.35,), (0.6, 1.2))
    shown = result(find_lateral(trials, rig, lateral_bench.constants))
    at = shown.parameter("mu_R(0.35 m/s)")
    assert at.identifiable
    assert at.low is not None and at.high is not None
    assert at.low <= DRY + 0.35 * VISCOUS <= at.high
    assert shown.parameter("mu_R_vis").verdict is Verdict.UNIDENTIFIABLE
    assert "more lateral speeds" in shown.parameter("mu_R_vis").advice


@pytest.mark.parametrize(
    ("speeds", "texts"),
    [
        ((0.2, 0.65), ["0.20", "0.65"]),
        ((0.0201, 0.0234), ["0.020", "0.023"]),
        ((0.35,), ["0.35"]),
    ],
)
def test_lateral_speeds_have_names_apart(speeds: tuple[float, ...], texts: list[str]) -> None:
    assert in_words(speeds) == texts


def recorded(trials: Trials, name: str) -> Trials:
    """Return ``trials`` as those of the recording ``name``."""
    return [replace(item, trial=replace(item.trial, recording=name)) for item in trials]


def test_recordings_that_disagree_are_named(
    fast: Trials, lateral_bench: LateralBench, rig: RigConstants
) -> None:
    worn = replace(lateral_bench, dry=1.2 * DRY, viscous=1.2 * VISCOUS)
    after = worn.sweep(3, SPEEDS_M_S[1:], CURRENTS_A)
    trials = [*recorded(fast, "before.mcap"), *recorded(after, "after.mcap")]
    shown = result(find_lateral(trials, rig, lateral_bench.constants))
    assert shown.gate is not None and shown.gate.outcome is FitOutcome.MISFIT
    assert "before.mcap, after.mcap disagree" in shown.warnings[0]
    assert all(entry.quoted is None for entry in (*shown.parameters, *shown.derived))
    (test,) = [item for item in shown.residual_tests if item.name == "agreement of recordings"]
    assert not test.passed


def test_recordings_of_equal_friction_agree(
    fast: Trials, lateral_bench: LateralBench, rig: RigConstants
) -> None:
    again = lateral_bench.sweep(3, SPEEDS_M_S[1:], CURRENTS_A)
    trials = [*recorded(fast, "one.mcap"), *recorded(again, "two.mcap")]
    shown = result(find_lateral(trials, rig, lateral_bench.constants))
    assert shown.gate is not None and shown.gate.outcome is FitOutcome.FITS
    (test,) = [item for item in shown.residual_tests if item.name == "agreement of recordings"]
    assert test.passed
    assert not any("disagree" in warning for warning in shown.warnings)


def refused(trials: Sequence[LateralTrial], rig: RigConstants, known: LateralConstants) -> str:
    with pytest.raises(DataError) as caught:
        find_lateral(trials, rig, known)
    return caught.value.message


def test_no_lateral_motion_is_refused(
    trials: Trials, lateral_bench: LateralBench, rig: RigConstants
) -> None:
    still = [replace(item, speed_m_s=0.0 * item.speed_m_s) for item in trials]
    assert "no trial moves sideways" in refused(still, rig, lateral_bench.constants)


def test_diverging_trial_is_named(
    fast: Trials, lateral_bench: LateralBench, rig: RigConstants
) -> None:
    """Such as with positions in mm that are taken for metres."""
    trials = [
        replace(item, trial=replace(item.trial, carriage_position_m=1e3 * position))
        for item in fast
        for position in [item.trial.carriage_position_m]
    ]
    message = refused(trials, rig, lateral_bench.constants)
    assert any(f"trial {item.trial.label} (current up to" in message for item in fast)
    assert re.search(r"travel \d{3} m\): its simulation leaves the numbers", message)


def test_one_current_is_refused(
    trials: Trials, lateral_bench: LateralBench, rig: RigConstants
) -> None:
    found = [item for item in trials if item.trial.current_a == 0.6]
    assert "needs at least 2 currents" in refused(found, rig, lateral_bench.constants)


def test_changing_lateral_speed_is_refused(
    trials: Trials, lateral_bench: LateralBench, rig: RigConstants
) -> None:
    ramps = [
        replace(item, speed_m_s=item.speed_m_s * np.linspace(0.2, 1.5, len(item.speed_m_s)))
        for item in trials
    ]
    assert "constant in none of 8 trials" in refused(ramps, rig, lateral_bench.constants)


def test_samples_that_are_nan_exclude_a_trial(
    fast: Trials, lateral_bench: LateralBench, rig: RigConstants
) -> None:
    broken = replace(fast[0], speed_m_s=np.full_like(fast[0].speed_m_s, np.nan))
    found = find_lateral([broken, *fast[1:]], rig, lateral_bench.constants)
    assert [item.label for item in found.family.rejected] == [fast[0].trial.label]
    assert "not numbers" in found.family.rejected[0].reason
    assert len(found.family.trials) == 3


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"lever": Known(0.0, 1e-4)}, "guide_lever is 0"),
        ({"mass_offset": Known(0.01, 1e-4)}, "mass_offset is 0.01 m"),
        ({"height": Known(-0.25, 1e-3)}, "guide_height is -0.25"),
        ({"dry": Known(0.0, 1e-3)}, "mu_R_dry is 0"),
    ],
)
def test_impossible_geometry_is_refused(
    lateral_bench: LateralBench, changed: dict[str, Any], says: str
) -> None:
    with pytest.raises(DataError, match=says):
        replace(lateral_bench.constants, **changed)
