"""Output error on trials of an independent simulator: right, or no number (lugre.md section 7)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from support.lugre.bench import FLOORS, known_rig

from rigd.analysis import DataError
from rigd.analysis.fitting.identifiability import Z_95
from rigd.analysis.fitting.model import to_natural
from rigd.analysis.fitting.profile import ProfileScan, axis
from rigd.analysis.output_error.estimator import OutputErrorFit, by_cost, conclude, estimate
from rigd.analysis.output_error.pipeline import fitted
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.output_error.whitened_residuals import OutputErrorModel, noise_at
from rigd.analysis.result import (
    Explanation,
    FitOutcome,
    FloatArray,
    Gate,
    IdentificationResult,
    Meaning,
    ResidualTest,
    Verdict,
)
from rigd_analyses.lugre.conclusion import conclude_group, identify_output_error
from rigd_analyses.lugre.model import MU_C, RATIO, SIGMA_1, V_S, friction_gradient
from rigd_analyses.lugre.quantities import DAMPING
from rigd_analyses.lugre.rig import kernel
from rigd_analyses.lugre.rig.current import simulated_current
from rigd_analyses.lugre.rig.estimates import estimates
from rigd_analyses.lugre.rig.family import RigFit, fit_group, rig_system, with_intervals
from rigd_analyses.lugre.rig.parts import free_part, rows_used, sort_out
from rigd_analyses.lugre.rig.result import result
from rigd_analyses.lugre.rig.ridge import effect_shown
from rigd_analyses.lugre.rig.standard_errors import HEIGHT, Beside, RigIdentification, beside
from rigd_analyses.lugre.rig.system import MASS
from rigd_analyses.lugre.slip_force.identify import Settings
from rigd_analyses.lugre.trials.known_constants import Known
from rigd_analyses.lugre.trials.trial import LugreTrial

CURRENTS_A = (0.3, 0.6, 0.9, 1.2)
Bench = Callable[..., Any]


@cache
def rig_parameters(floor_name: str, bench: Bench) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the true parameters of the recursion, without ripple."""
    rig = bench(floor_name)
    floor, known = rig.truth, known_rig(rig.constants)
    arm_n = 0.01 * rig.constants.normal_force_n * (0.07 + 0.03) / 0.04
    return np.array(
        [
            floor.v_s, floor.mu_c, np.log(floor.mu_s / floor.mu_c), floor.s0, floor.s1, floor.s2,
            known.drive_gain.value, known.no_load.value, known.viscous.value + 2e-5 * arm_n,
            known.inertia.value, known.guide_friction.value, floor.mu_rol, 0.0, 0.0, 0.05, 0.0,
            0.0, 0.0, 0.0, 0.0,
        ]
    )  # fmt: skip


def test_recursion_agrees_with_an_independent_simulator(bench: Bench) -> None:
    rig = bench("pvc", noisy=False)
    trial = rig.trial(1.05, 1)
    free = slice(300, int(np.argmax(trial.carriage_position_m > 1.14)))
    current = simulated_current(trial.motor_current_a[free], 3)
    states, _ = kernel.integrate(
        rig_parameters("pvc", bench), current.current_a, current.jumps,
        trial.wheel_angle_rad[free], np.zeros_like(current.current_a), 18.0, 3.9593,
        3.9593 * 9.81, 1e-3, False,
    )  # fmt: skip
    slip = 0.05 * states[:, kernel.ANGLE] - states[:, kernel.POSITION]
    true = 0.05 * trial.wheel_angle_rad[free] - trial.carriage_position_m[free]
    np.testing.assert_allclose(slip, true, atol=2e-6)  # m; one count of the guide is 31e-6
    np.testing.assert_allclose(
        states[:, kernel.POSITION], trial.carriage_position_m[free], atol=2e-4
    )


def test_sensitivities_agree_with_differences(bench: Bench) -> None:
    q = rig_parameters("pvc", bench).copy()
    q[kernel.NAMES.index("ripple_sin")] = 0.3
    q[kernel.NAMES.index("wheel_delay")] = 1e-3
    current = np.concatenate([np.zeros(20), np.full(300, 1.0), np.full(200, -0.5)])
    jumps = (np.abs(np.diff(current, append=current[-1])) > 0.0).astype(np.float64)
    angle = np.linspace(0.0, 3.0, current.size)
    turning = np.gradient(angle, 1e-3)
    seen = (current, jumps, angle, turning, 18.0, 4.0, 39.0, 1e-3)

    def states(values: np.ndarray[Any, np.dtype[np.float64]]) -> Any:
        return kernel.integrate(values, *seen, False)[0]

    exact = kernel.integrate(q, *seen, True)[1]
    for column, name in enumerate(kernel.NAMES):
        # A smaller step shows that the number of steps near a turn depends on the speed.
        step = 1e-5 * max(abs(q[column]), 1e-2)
        up, down = q.copy(), q.copy()
        up[column] += step
        down[column] -= step
        difference = (states(up) - states(down)) / (2.0 * step)
        for output in range(5):
            scale = np.max(np.abs(difference[:, output]))
            np.testing.assert_allclose(
                exact[:, output, column], difference[:, output], atol=2e-4 * scale, err_msg=name
            )


def test_slow_sampling_fits_and_gives_the_friction(bench: Bench) -> None:
    """At 2 ms dry friction at rest is too fast for a single step."""
    rig = replace(bench("pvc"), dt_s=2e-3)
    found = fit_group(
        rig.sweep(3, (0.3, 0.6, 1.2)), rig.constants, known_rig(rig.constants), Settings(starts=1)
    )
    assert found.gate.outcome is FitOutcome.FITS, found.gate.sentence
    theta, truth = found.whole.fit.theta, rig.truth
    for value, true in zip(theta[3:6], (truth.s0, truth.s1, truth.s2), strict=True):
        assert value == pytest.approx(true, rel=0.05)


@pytest.fixture(scope="module")
def begun(bench: Bench) -> RigFit:
    rig = bench("pvc")
    return fit_group(rig.sweep(3, CURRENTS_A), rig.constants, known_rig(rig.constants))


@pytest.fixture(scope="module")
def pvc(begun: RigFit) -> IdentificationResult:
    return conclude_group(begun)


def test_intervals_hold_the_truth_and_are_narrow(pvc: IdentificationResult, bench: Bench) -> None:
    floor = bench("pvc").truth
    truth = {
        "V_s": floor.v_s, "mu_c": floor.mu_c, "mu_s": floor.mu_s, "sigma_0": floor.s0,
        "sigma_1": floor.s1, "sigma_2": floor.s2, "mu_s-mu_c": floor.mu_s - floor.mu_c,
    }  # fmt: skip
    assert pvc.gate is not None
    assert pvc.gate.outcome is FitOutcome.FITS
    widest = {"V_s": 2.0, "sigma_1": 0.7, "mu_s-mu_c": 0.5}
    for name, value in truth.items():
        found = pvc.parameter(name)
        assert found.low is not None and found.high is not None, name
        assert found.low <= value <= found.high, name
        assert found.high - found.low < widest.get(name, 0.2) * value, name


def test_start_that_ends_wrong_is_left(begun: RigFit) -> None:
    start = (0.87, 2.0, 0.0, 4.0, 1.5, 0.17)  # 16 times the noise off
    system = begun.family.system
    known = [item.parameter.start for item in system.shared[len(start) :]]
    wrong = replace(begun.family, starts=(np.array([*start, *known]),))
    assert 2.0 * wrong.fitted().fit.cost > 10.0 * len(begun.whole.model.mask)
    assert fitted(wrong).fit.cost == pytest.approx(begun.whole.fit.cost, abs=0.5)


def shown(
    begun: RigFit, whole: OutputErrorFit, gate: Gate, *variants: FloatArray
) -> RigIdentification:
    return RigIdentification(begun.family, whole, gate, variants=variants, visited=(0.0, 1.0))


def test_right_rig_is_named_with_small_chance(pvc: IdentificationResult) -> None:
    assert set(pvc.alarms) >= {"causes of a misfit", "steady friction"}
    assert pvc.false_alarm == pytest.approx(0.0101)


def test_fit_that_has_not_converged_gives_no_number(begun: RigFit) -> None:
    assert begun.whole.converged
    left = begun.whole.left.copy()
    left[3] = 2.0 * THRESHOLDS.max_left_sd
    result = conclude_group(replace(begun, whole=replace(begun.whole, left=left)))
    assert result.gate is not None
    assert result.gate.outcome is FitOutcome.MISFIT
    assert "not converged: sigma_0 has 1 standard errors to go" in result.gate.sentence
    assert all(entry.quoted is None for entry in (*result.parameters, *result.derived))


def test_change_too_small_to_refuse_is_warned_of(begun: RigFit) -> None:
    drift = ResidualTest("steady friction", 17.0, 4e-5, False, "The friction rises.")
    apart = ResidualTest("agreement of recordings", 16.0, 6e-5, False, "a, b disagree.")
    result = conclude_group(replace(begun, tests=(drift, apart)))
    assert result.warnings == ("a, b disagree.", "The friction rises.")
    assert result.parameter("sigma_0").identifiable


def test_effect_within_doubt_leaves_stribeck_speed_open(begun: RigFit) -> None:
    """What else explains a misfit as well would take a third of the effect away."""
    moved = np.zeros(6)
    moved[MU_C], moved[RATIO] = 0.04, -0.08
    result = conclude_group(replace(begun, shifts=(moved,)))
    assert result.parameter("V_s").quoted is None
    assert "a Stribeck effect is not shown" in result.parameter("mu_s-mu_c").sentence
    assert result.parameter("sigma_0").identifiable


def test_fit_without_effect_leaves_stribeck_speed_open(begun: RigFit) -> None:
    """The best fit of some recordings on stone has mu_s = mu_c: no logarithm of its height."""
    whole = begun.whole
    fitted = replace(whole.fit, theta=whole.fit.theta.copy())
    fitted.theta[RATIO] = 0.0
    flat = shown(begun, replace(whole, fit=fitted), begun.gate, fitted.theta)
    assert not effect_shown(scan_of(begun, 0.0), flat.doubt(HEIGHT))
    other = shown(begun, whole, begun.gate, fitted.theta)  # flat with another filter
    assert other.doubt(HEIGHT) == other.method(HEIGHT) == math.inf


def scan_of(begun: RigFit, low: float | None) -> ProfileScan:
    """Return a profile of V_s from ``low``: the optimum, and a point with a statistic of 5."""
    best, inverse = begun.whole.fit.theta, begun.whole.inverse
    return ProfileScan(
        np.log(best[:1] * [1.0, 2.0]), np.array([0.0, 5.0]), np.stack([best, best]), 3.84, low, 1.0,
        inverses=np.stack([inverse, inverse]), direction=axis(len(best), V_S),
    )  # fmt: skip


def test_open_stribeck_speed_widens_the_region(begun: RigFit) -> None:
    closed, free = (
        [item.reach for item in beside({"V_s": scan_of(begun, low)})] for low in (-9.0, None)
    )
    assert closed == pytest.approx([1.96], abs=1e-3)
    assert free == pytest.approx([np.sqrt(5.991), np.sqrt(5.991 - 5.0)], abs=1e-3)


def test_interval_reaches_around_an_accepted_point(begun: RigFit) -> None:
    whole = begun.whole
    theta, inverse = whole.fit.theta[:6].copy(), whole.inverse[:6, :6].copy()
    gate = Gate(FitOutcome.FITS, "")
    alone = shown(begun, whole, gate)
    usual = alone.ridge(DAMPING)
    assert usual == pytest.approx([Z_95 * alone.chance(DAMPING.log_gradient(theta))] * 2)
    theta[SIGMA_1] *= 1.1
    inverse[SIGMA_1, SIGMA_1] *= 9.0
    other = Beside(theta, inverse, Z_95)
    below, above = replace(alone, beside=(other,)).ridge(DAMPING)
    assert above - below == pytest.approx(2.0 * np.log(1.1))
    assert above + below == pytest.approx(2.0 * 3.0 * usual[0])


def test_interval_beyond_all_numbers_is_open(begun: RigFit) -> None:
    whole, line = begun.whole, scan_of(begun, None)
    inverse = 1e8 * whole.inverse[:6, :6]
    point = Beside(whole.fit.theta[:6], inverse, 1e4)
    found = shown(begun, whole, Gate(FitOutcome.FITS, ""))
    found = replace(found, scans={"V_s": line}, beside=(point,))
    (damping,) = (item for item in estimates(found) if item.name == "sigma_1")
    assert (damping.low, damping.high) == (None, None)
    assert damping.verdict is Verdict.UNIDENTIFIABLE


def test_unexplained_rest_is_no_lack_of_data(begun: RigFit) -> None:
    moved = np.zeros(6)
    moved[SIGMA_1] = 0.8  # of its logarithm
    entry = conclude_group(replace(begun, shifts=(moved,))).parameter("sigma_1")
    assert entry.quoted is None
    assert entry.verdict is Verdict.UNRESOLVED
    assert "what is left unexplained" in entry.sentence


def test_point_beside_the_optimum_has_steps_left(begun: RigFit) -> None:
    model, best = begun.whole.model, begun.whole.fit
    half = 0.5 * np.sqrt(begun.whole.covariance[3, 3])
    scaled = best.scaled + half * begun.whole.inverse[:, 3] / begun.whole.inverse[3, 3]
    off = conclude(
        model, replace(best, scaled=scaled, theta=to_natural(model.parameters, scaled)), 50
    )
    assert off.left[3] == pytest.approx(-0.5, abs=0.05)


def test_optimum_that_takes_much_for_noise_loses(begun: RigFit) -> None:
    """Under noise of its own, its cost is the least."""
    whole = begun.whole
    theta = whole.fit.theta.copy()
    theta[3] *= 1.01
    system = whole.model.system
    loud = tuple(replace(item, scale=0.5 * item.scale) for item in noise_at(system, theta))
    wrong = replace(whole.fit, theta=theta, cost=OutputErrorModel(system, loud).cost(theta))
    assert wrong.cost < whole.fit.cost
    branches = [(OutputErrorModel(system, loud), wrong), (whole.model, whole.fit)]
    (cost, (_, best)), (other, _) = by_cost(branches)
    assert best is whole.fit
    assert other > cost + 100.0


def test_paperboard_ends_at_its_optimum(bench: Bench) -> None:
    """On its ridge V_s, mu_c and mu_s stand in for one another."""
    rig = bench("paperboard")
    begun = fit_group(rig.sweep(2, CURRENTS_A), rig.constants, known_rig(rig.constants))
    assert begun.whole.converged
    assert begun.gate.outcome is FitOutcome.FITS


def test_slow_trials_leave_friction_beyond_open(bench: Bench) -> None:
    """The fit has no Stribeck effect; one with V_s above all slip, and half of mu_c, fits as well.

    mu_c was given as 0.0658 to 0.0712 with 0.04 as the truth.
    """
    rig = bench("paperboard")
    trials = [rig.trial(current, 3 + k) for k, current in enumerate((0.25, 0.27, 0.3))]
    begun = fit_group(trials, rig.constants, known_rig(rig.constants))
    result = conclude_group(begun)
    assert begun.gate.outcome is FitOutcome.FITS
    assert result.parameter("mu_c").low is None
    static = result.parameter("mu_s")
    assert static.low is not None and static.high is not None
    assert static.low < rig.truth.mu_s < static.high


def test_trial_that_cannot_be_simulated_is_named(bench: Bench) -> None:
    rig = bench("pvc")
    trials = [replace(trial, recording="run.mcap") for trial in rig.sweep(1, CURRENTS_A)]
    light = known_rig(
        rig.constants, wheel_inertia=Known(1e-9, 1e-12), motor_inertia=Known(0.0, 0.0)
    )
    with pytest.raises(DataError, match=r"run\.mcap: trial .* A.*leaves the numbers") as refused:
        identify_output_error(trials, rig.constants, light)
    assert "--set" in str(refused.value)


def test_friction_curve_holds_the_truth(pvc: IdentificationResult, bench: Bench) -> None:
    true = bench("pvc").truth.g(pvc.curve.x)
    assert np.all((pvc.curve.low <= true) & (true <= pvc.curve.high))
    middle = np.argmin(np.abs(pvc.curve.x - 0.02))
    assert pvc.curve.high[middle] - pvc.curve.low[middle] < 0.12 * true[middle]


def test_band_of_curve_counts_noise_once(begun: RigFit) -> None:
    """The profiles' points are noise too: added to it, the band was wider by half."""
    found = with_intervals(begun)
    curve = result(found).curve
    place = int(np.argmin(np.abs(curve.x - 0.02)))
    theta = found.theta[:6]
    gradient = friction_gradient(theta, curve.x[[place]]) / curve.y[place]
    noise = Z_95 * found.chance(gradient)
    reach = 0.5 * math.log(curve.high[place] / curve.low[place])
    assert noise < reach < 1.15 * math.hypot(noise, Z_95 * found.weight_u)


def test_data_stand_beside_the_curve(pvc: IdentificationResult) -> None:
    assert len(pvc.curve.seen) >= 5
    for item in pvc.curve.seen:
        g = float(np.interp(item.x, pvc.curve.x, pvc.curve.y))
        assert item.low < item.median < item.high
        assert item.median == pytest.approx(g, rel=0.15)


def test_each_constant_is_in_the_budget(pvc: IdentificationResult) -> None:
    sources = pvc.budget["sigma_0"]
    assert {"noise", "mass of the carriage", "gravity", "filter of the current"} <= set(sources)
    assert len(sources) >= 15
    entry = pvc.parameter("sigma_0")
    assert entry.standard_error is not None
    combined = math.sqrt(sum(u**2 for u in sources.values()))
    assert combined == pytest.approx(entry.standard_error / entry.estimate, rel=0.1)


def test_budget_keeps_filters_and_unexplained_apart(begun: RigFit) -> None:
    whole = begun.whole
    varies = Explanation("dirt", "1", 0.08, 0.01, 90.0, meaning=Meaning.VARIES)
    gate = Gate(FitOutcome.CORRECTED, "It varies.", (), (varies,))
    filtered = whole.fit.theta.copy()
    filtered[SIGMA_1] *= 1.01
    budget = shown(begun, whole, gate, filtered).budget(DAMPING)
    assert budget["filter of the current"] == pytest.approx(math.log(1.01))
    assert budget["what varies or is not explained"] == pytest.approx(0.08)


def test_each_row_is_used_or_has_a_reason(pvc: IdentificationResult, bench: Bench) -> None:
    account = pvc.preprocessing
    trials = {trial.label: trial for trial in bench("pvc").sweep(3, CURRENTS_A)}
    assert account.rows.keys() == trials.keys()
    for label, rows in account.rows.items():
        assert rows.used + sum(rows.not_used.values()) == len(trials[label].t_s)
        assert any("first drop of the current" in why for why in rows.not_used)
    total = sum(len(trial.t_s) for trial in trials.values())
    assert f"{pvc.samples} of {total} rows used" in account.rows_in_words


def test_braking_rows_count_until_the_carriage_is_held(bench: Bench) -> None:
    trial = bench("pvc").trial(0.9, 1)
    still_free = len(trial.t_s) - 40
    held = replace(trial, held=(np.arange(len(trial.t_s)) >= still_free).astype(np.float64))
    part = free_part(held, 1e-3, Settings())
    assert part.stop == still_free
    assert part.stop > free_part(trial, 1e-3, Settings()).stop
    rows = rows_used(held, part)
    assert rows.not_used["after the end (carriage held)"] == 40


def test_too_little_rest_at_slow_sampling_is_refused(bench: Bench) -> None:
    trial = replace(bench("pvc"), dt_s=5e-3).trial(0.9, 1)
    assert free_part(trial, 5e-3, Settings()).start == 30
    short = replace(
        trial,
        **{
            name: getattr(trial, name)[35:]
            for name in (
                *("t_s", "wheel_angle_rad", "carriage_position_m"),
                *("acceleration_m_s2", "motor_current_a"),
            )
        },
    )
    words = re.escape("trial 0.90 A: 35 samples of rest (175 ms) before the current step, need 40")
    with pytest.raises(DataError, match=words):
        free_part(short, 5e-3, Settings())


def test_unknown_gravity_is_named_where_it_decides(bench: Bench) -> None:
    rig = bench("pvc")
    stated = known_rig(rig.constants, gravity=Known(9.81, 6.0))
    result = identify_output_error(rig.sweep(3, CURRENTS_A), rig.constants, stated)
    entry = result.parameter("sigma_0")
    assert entry.verdict is Verdict.CONSTANTS
    assert (entry.quoted, entry.low, entry.high) == (None, None, None)
    assert "owed to gravity: its u must be" in entry.sentence
    assert result.parameter("V_s").identifiable  # a speed: no weight is in it


def test_diameter_for_radius_gives_no_number(bench: Bench) -> None:
    rig = bench("stone")
    twice = replace(rig.constants, wheel_radius_m=0.1)
    stated = known_rig(rig.constants, wheel_radius=Known(0.1, 1e-4))
    result = identify_output_error(rig.sweep(1, CURRENTS_A), twice, stated)
    assert result.gate is not None
    assert result.gate.outcome is FitOutcome.MISFIT
    assert all(entry.quoted is None for entry in (*result.parameters, *result.derived))
    assert re.search(r"0\.0(49\d*|50?\d*) .*m, stated 0\.1 m", result.gate.sentence)
    assert "diameter" in result.gate.sentence
    assert result.warnings[0] == result.gate.sentence
    line = next(s for s in result.preprocessing.statements if s.startswith("wheel_radius"))
    assert re.search(r"moved by -69\d\.\d\d of its uncertainty; left to the data", line)


def test_start_that_diverges_is_passed_over(bench: Bench) -> None:
    rig = bench("pvc")
    trials = rig.sweep(1, CURRENTS_A)
    parts, _ = sort_out(trials, [1e-3] * len(trials), Settings())
    system = rig_system(parts, known_rig(rig.constants), rig_parameters("pvc", bench)[:6])
    stated = np.array([item.parameter.start for item in system.shared])
    wild = stated.copy()
    wild[:6] = 1e-4, 1e-4, 0.0, 1e4, 1e-4, 1e-3
    local = np.array([item.parameter.start for item in system.local])
    assert not np.all(np.isfinite(system.simulate(0, wild, local)))
    found = estimate(system, [wild, stated], 50)  # a RuntimeWarning would fail the test
    assert found.fit.theta[3] == pytest.approx(rig.truth.s0, rel=0.05)
    with pytest.raises(DataError, match="leaves the numbers"):
        estimate(system, [wild], 50)


def test_late_encoder_is_found_and_corrected(bench: Bench) -> None:
    rig = bench("stone")
    late = [
        replace(t, wheel_angle_rad=np.append(t.wheel_angle_rad[:1], t.wheel_angle_rad[:-1]))
        for t in rig.sweep(1, CURRENTS_A)
    ]
    result = identify_output_error(late, rig.constants, known_rig(rig.constants))
    stiffness = result.parameter("sigma_0")
    assert stiffness.low is not None and stiffness.high is not None
    assert stiffness.low <= rig.truth.s0 <= stiffness.high
    line = next(s for s in result.preprocessing.statements if s.startswith("wheel_delay"))
    found = re.search(r"fitted ([-0-9.e]+),", line)
    assert found is not None
    assert float(found[1]) == pytest.approx(1e-3, abs=2e-4)  # s: one sample


def test_trials_without_motion_are_refused(bench: Bench) -> None:
    rig = bench("pvc")
    with pytest.raises(DataError, match="moved"):
        identify_output_error(
            rig.sweep(1, (0.1, 0.12, 0.14)), rig.constants, known_rig(rig.constants)
        )


def with_friction(bench: Bench, share: float, current_a: float, recording: str = "") -> LugreTrial:
    """Return a trial on PVC whose friction is ``share`` of what it was."""
    floor = FLOORS["pvc"]
    worn = replace(floor, mu_c=floor.mu_c * share, mu_s=floor.mu_s * share)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(FLOORS, "worn", worn)
        trial: LugreTrial = bench("worn").trial(current_a, 1)
    return replace(trial, recording=recording)


def test_wear_over_the_trials_gives_no_number(bench: Bench) -> None:
    rig, currents = bench("pvc"), (0.9, 0.3, 1.2, 0.6, 1.05, 0.45)
    worn = [with_friction(bench, 1.0 - 0.02 * k, current) for k, current in enumerate(currents)]
    result = identify_output_error(worn, rig.constants, known_rig(rig.constants))
    assert result.gate is not None
    assert result.gate.outcome is FitOutcome.MISFIT
    assert "falls from trial to trial" in result.gate.sentence
    assert result.warnings[0] == result.gate.sentence


def test_recordings_that_disagree_are_not_pooled(bench: Bench) -> None:
    rig = bench("pvc")
    trials = [
        with_friction(bench, share, current, name)
        for name, share in (("before.mcap", 1.0), ("after.mcap", 0.93))
        for current in CURRENTS_A
    ]
    both = identify_output_error(trials, rig.constants, known_rig(rig.constants))
    assert both.gate is not None
    assert both.gate.outcome is FitOutcome.MISFIT
    assert "--group-by recording" in both.gate.sentence


def test_recordings_that_agree_are_pooled(bench: Bench) -> None:
    rig = bench("pvc")
    trials = [
        replace(t, recording=f"{seed}.mcap") for seed in (1, 2) for t in rig.sweep(seed, CURRENTS_A)
    ]
    both = identify_output_error(trials, rig.constants, known_rig(rig.constants))
    assert both.gate is not None
    assert both.gate.outcome is FitOutcome.FITS
    assert both.parameter("sigma_0").identifiable


def test_creeping_carriage_is_left_out_and_named(bench: Bench) -> None:
    rig = bench("pvc")
    still = rig.trial(0.1, 1)
    creeping = replace(
        still, label="creeps",
        carriage_position_m=still.carriage_position_m + 0.01 * np.maximum(still.t_s - 0.35, 0.0),
    )  # fmt: skip
    result = identify_output_error(
        [*rig.sweep(1, CURRENTS_A), creeping], rig.constants, known_rig(rig.constants)
    )
    assert [item.label for item in result.preprocessing.rejected] == ["creeps"]
    assert "crept" in result.preprocessing.rejected[0].reason


def test_fitted_mass_moves_as_a_heavier_rig(bench: Bench) -> None:
    rig = bench("pvc")
    trials = rig.sweep(1, CURRENTS_A)
    parts, _ = sort_out(trials, [1e-3] * len(trials), Settings())
    known = known_rig(rig.constants)
    friction = rig_parameters("pvc", bench)[:6]
    light = rig_system(parts, known, friction)
    heavy = rig_system(
        parts, replace(known, mass=Known(1.05 * known.mass.value, known.mass.u)), friction
    )
    shared, local = (np.array([item.parameter.start for item in part])
                     for part in (heavy.shared, heavy.local))  # fmt: skip
    np.testing.assert_allclose(
        light.simulate(2, shared, local), heavy.simulate(2, shared, local), atol=1e-12
    )
    _, slopes = light.linearise(2, shared, local)
    more = shared.copy()
    more[MASS] *= 1.0 + 1e-6
    step = light.simulate(2, more, local) - light.simulate(2, shared, local)
    difference = step / (1e-6 * shared[MASS])
    scale = np.max(np.abs(difference), axis=0)
    np.testing.assert_allclose(slopes[:, :, MASS] / scale, difference / scale, atol=1e-3)


def test_mass_is_a_constant_with_its_doubt(bench: Bench) -> None:
    rig, mass = bench("pvc"), bench("pvc").constants.mass_kg
    rough = known_rig(rig.constants, mass=Known(1.04 * mass, 0.04 * mass))
    result = identify_output_error(rig.sweep(3, CURRENTS_A), rig.constants, rough)
    line = next(s for s in result.preprocessing.statements if s.startswith("mass "))
    assert f"stated {1.04 * mass:.5g} kg" in line
    for name in ("sigma_0", "sigma_2", "mu_s"):
        entry = result.parameter(name)
        true = {"sigma_0": rig.truth.s0, "sigma_2": rig.truth.s2, "mu_s": rig.truth.mu_s}[name]
        assert entry.low is not None and entry.high is not None, name
        assert entry.low <= true <= entry.high, name


def test_mass_is_in_the_budget(begun: RigFit) -> None:
    gradient = np.zeros(len(begun.whole.fit.theta))
    gradient[3] = 1.0
    assert begun.whole.budget(gradient)["mass of the carriage"] > 0.0


def test_recordings_begin_at_angles_of_their_own(bench: Bench) -> None:
    """The rollers shake with the angle from where each recording's encoder began."""
    rig, turned = bench("pvc"), 0.1
    trials = [
        replace(t, recording=name, wheel_angle_rad=t.wheel_angle_rad + offset)
        for name, seed, offset in (("first.mcap", 1, 0.0), ("second.mcap", 2, turned))
        for t in rig.sweep(seed, CURRENTS_A)
    ]
    begun = fit_group(trials, rig.constants, known_rig(rig.constants))
    assert begun.gate.outcome is FitOutcome.FITS
    names = [item.parameter.name for item in begun.whole.model.system.shared]
    fitted = dict(zip(names, begun.whole.fit.theta, strict=False))
    first, second = (
        complex(fitted[f"ripple_cos{of}"], fitted[f"ripple_sin{of}"])
        for of in ("", " of second.mcap")
    )
    assert abs(first) == pytest.approx(0.3, abs=0.02)  # 1/s, as the bench makes it
    orders = known_rig(rig.constants).roller_transitions
    assert np.angle(second / first) == pytest.approx(orders * turned, abs=0.1)
