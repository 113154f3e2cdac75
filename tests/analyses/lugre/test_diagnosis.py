"""What is wrong on a rig is named with its size, and nothing is named if nothing is wrong."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.cases import some
from support.lugre.kinds import KINDS
from support.lugre.wrong import CONSTANT, Program, World, control, right

from rigd.analysis.fitting.model import to_natural
from rigd.analysis.fitting.whiteness import largest_jump, levels, loudest_band
from rigd.analysis.output_error.diagnosis import diagnose
from rigd.analysis.output_error.estimator import conclude, estimate
from rigd.analysis.output_error.innovations import Deviations, Whitener
from rigd.analysis.output_error.score import holm
from rigd.analysis.result import FitOutcome, IdentificationResult
from rigd_analyses.lugre.conclusion import identify_output_error
from rigd_analyses.lugre.rig.family import fit_group, rig_system
from rigd_analyses.lugre.rig.outputs import late
from rigd_analyses.lugre.rig.parts import sort_out
from rigd_analyses.lugre.slip_force.identify import Settings
from rigd_analyses.lugre.trials.trial import sampling_period_s

FEW = tuple(((amps, 3.0),) for amps in (0.45, 0.75, 1.05, 1.35))
SLOW = tuple(((amps, 3.0),) for amps in (0.3, 0.6, 0.9, 1.2))


def found(world: World, program: Program) -> IdentificationResult:
    return identify_output_error(
        replace(world, program=program).trials(1), world.constants, world.rig
    )


def test_a_measuring_wheel_out_of_centre_is_named() -> None:
    world = replace(right("pvc"), guide_eccentric=1e-4)
    result = found(world, SLOW)
    assert result.gate is not None
    assert result.gate.outcome is FitOutcome.CORRECTED
    (first, *_) = result.gate.explanations
    assert "carriage encoder each 12" in first.name  # mm; a turn is 125.7 mm
    assert first.size == pytest.approx(1e-4, rel=0.1)
    stiffness = result.parameter("sigma_0")
    assert stiffness.low is not None and stiffness.high is not None
    assert stiffness.low <= world.physics.s0 <= stiffness.high


def test_a_wheel_that_grows_is_named() -> None:
    """It was taken for drag, and sigma_0 was off by 3.3 half widths."""
    base = right("pvc")
    world = replace(base, physics=base.physics._replace(swells=2e-5))
    result = found(world, SLOW)
    assert result.gate is not None
    (first, *_) = result.gate.explanations
    assert first.name == "a drive wheel that grows with the square of the speed"
    assert first.size == pytest.approx(2e-5, rel=0.1)
    stiffness = result.parameter("sigma_0")
    assert stiffness.low is not None and stiffness.high is not None
    assert stiffness.low <= world.physics.s0 <= stiffness.high


def test_a_late_accelerometer_is_named() -> None:
    """It was called a delay of the current."""
    base = right("pvc")
    world = replace(base, accelerometer=replace(base.accelerometer, delay_s=5e-3))
    result = found(world, CONSTANT[1::2])
    assert result.gate is not None
    assert result.gate.outcome is FitOutcome.CORRECTED
    (first,) = result.gate.explanations
    assert first.name == "delay of the accelerometer"
    assert first.size == pytest.approx(5e-3, abs=2e-4)
    stiffness = result.parameter("sigma_0")
    assert stiffness.low is not None and stiffness.high is not None
    assert stiffness.low <= world.physics.s0 <= stiffness.high


@pytest.mark.parametrize(
    ("late_s", "names"),
    [
        ({"wheel": 5e-3}, {"delay of the wheel encoder"}),
        ({"guide": 5e-3}, {"delay of the carriage encoder"}),
        ({"wheel": 5e-3, "guide": 5e-3},
         {"delay of the wheel encoder", "delay of the carriage encoder"}),
    ],
)  # fmt: skip
def test_each_late_encoder_is_named(late_s: dict[str, float], names: set[str]) -> None:
    """A late wheel encoder was a shaft that winds up, both a delay of the current."""
    base = right("pvc")
    late_ones = {name: replace(getattr(base, name), delay_s=by) for name, by in late_s.items()}
    result = found(replace(base, **late_ones), SLOW)
    assert result.gate is not None
    assert result.gate.outcome is FitOutcome.CORRECTED
    assert {item.name for item in result.gate.explanations} == names
    for item in result.gate.explanations:
        assert item.size == pytest.approx(5e-3, abs=2e-4)
    stiffness = result.parameter("sigma_0")
    assert stiffness.low is not None and stiffness.high is not None
    assert stiffness.low <= base.physics.s0 <= stiffness.high


@pytest.mark.parametrize("late_s", [-7.3e-3, -2e-4, 3e-4, 5.2e-3])
def test_delays_move_readings_as_their_derivatives_say(late_s: float) -> None:
    world = replace(right("pvc"), program=FEW[:3])
    trials = world.trials(1)
    parts, _ = sort_out(trials, [sampling_period_s(trial) for trial in trials], Settings())
    q = world.physics
    friction = np.array([q.v_s, q.mu_c, math.log(q.mu_s / q.mu_c), q.s0, q.s1, q.s2])
    system = rig_system(parts, world.rig, friction)
    shared = np.array([unknown.parameter.start for unknown in system.shared])
    local = np.zeros(len(system.local))
    names = [unknown.parameter.name for unknown in system.shared]
    at_once = system.simulate(0, shared, local)
    for name, output in (("carriage_delay", 1), ("wheel_delay", 0)):
        place = names.index(name)
        late_one, later = shared.copy(), shared.copy()
        late_one[place], later[place] = late_s, late_s + 1e-7
        seen, slopes = system.linearise(0, late_one, local)
        np.testing.assert_array_equal(seen, system.simulate(0, late_one, local))
        difference = (system.simulate(0, later, local) - seen) / 1e-7
        np.testing.assert_allclose(
            slopes[:, output, place], difference[:, output], rtol=1e-3, atol=1e-3
        )
        if late_s < 0.0:
            continue
        rows = np.arange(len(seen))
        travel, read = (  # of the carriage, or of the wheel
            part[:, 1] if output else part[:, 0] + part[:, 1] for part in (at_once, seen)
        )
        exact = np.interp(rows - late_s / system.period_s, rows, travel)
        np.testing.assert_allclose(read, exact, atol=2e-6)  # a fifteenth of a count


def test_late_reading_lies_between_the_samples() -> None:
    time = np.arange(200.0)[:, None]
    seen, slope = late(np.sin(0.05 * time), 2.3)
    inside = slice(5, -5)
    np.testing.assert_allclose(seen[inside], np.sin(0.05 * (time - 2.3))[inside], atol=1e-5)
    np.testing.assert_allclose(
        slope[inside], -0.05 * np.cos(0.05 * (time - 2.3))[inside], atol=1e-4
    )
    np.testing.assert_array_equal(late(time, 3.0)[0][5:], time[5:] - 3.0)


def test_a_shaft_that_winds_up_is_named() -> None:
    base = right("pvc")
    world = replace(base, physics=base.physics._replace(shaft=1000.0))
    result = found(world, CONSTANT)
    assert result.gate is not None
    assert result.gate.outcome is FitOutcome.CORRECTED
    (first, *_) = result.gate.explanations
    assert first.name == "a shaft between motor and wheel that winds up"
    assert first.size == pytest.approx(1.0 / 1000.0, rel=0.3)
    stiffness = result.parameter("sigma_0")
    assert stiffness.low is not None and stiffness.high is not None
    assert stiffness.low <= world.physics.s0 <= stiffness.high


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("cable drags, viscous", "drag of a cable"),
        ("accelerometer late", "delay of the accelerometer"),
    ],
)
def test_constant_far_from_stated_is_named(kind: str, name: str) -> None:
    """20 of its uncertainties: the fit ended on a bound of 8, and nothing explained the misfit."""
    (wrong,) = (item for item in KINDS if item.name == kind)
    world = replace(wrong.world(right("pvc"), wrong.sizes[2]), program=CONSTANT[1::2])
    begun = fit_group(world.trials(1), world.constants, world.rig)
    assert begun.gate.outcome is FitOutcome.MISFIT
    (first,) = begun.gate.explanations
    assert first.name == name
    assert first.size == pytest.approx(wrong.sizes[2], rel=0.01)


def test_hum_of_the_accelerometer_is_told_from_current() -> None:
    """The mains were looked for on the current alone."""
    base = right("pvc")
    world = replace(base, program=FEW, accelerometer=replace(base.accelerometer, hum=0.1))
    begun = fit_group(world.trials(1), world.constants, world.rig)
    (first,) = begun.gate.explanations
    assert first.name == "a hum of 50 Hz on the accelerometer"
    assert first.size == pytest.approx(0.1, rel=0.1)


def test_law_just_not_seen_is_in_the_interval() -> None:
    """The exponent is 0.55: V_s was off by 7.7 half widths without a word, mu_s by 2.4."""
    base = right("pvc")
    world = replace(base, physics=base.physics._replace(exponent=0.55))
    result = found(world, tuple(((amps, 3.0),) for amps in (0.3, 0.45, 0.6, 0.9, 1.2, 1.5)))
    assert result.gate is not None
    assert result.gate.outcome is FitOutcome.FITS
    for name in ("V_s", "mu_s", "mu_c", "sigma_0"):
        entry = result.parameter(name)
        if entry.quoted is not None:
            assert entry.low is not None and entry.high is not None
            assert entry.low <= world.truth[name] <= entry.high, name


def test_V_s_of_slip_hardly_seen_is_refused() -> None:
    """V_s was 0.34 mm/s for 1.96 m/s, of 0.1 mm slid below it; the bristle follows in 10 mm."""
    (kind,) = (kind for kind in KINDS if kind.name == "accelerometer's gain and slope")
    world = kind.world(right("stone"), kind.sizes[0])
    result = identify_output_error(world.trials(369), world.constants, world.rig)
    assert result.parameter("V_s").quoted is None
    friction = [result.parameter(name) for name in ("mu_c", "mu_s")]
    given = [entry for entry in friction if entry.quoted is not None]
    assert len(given) < 2  # one of them is g where nothing slid
    for entry in given:
        assert entry.low is not None and entry.high is not None
        assert entry.low <= world.truth[entry.name] <= entry.high
    assert result.curve.x[0] > 1e-3


def test_small_backlash_is_named_and_intervals_hold() -> None:
    """1 mrad: it looked like an error of the wheel encoder that depends on the slip."""
    (kind,) = [kind for kind in KINDS if kind.name == "gear has backlash"]
    world = kind.world(right("pvc"), kind.sizes[0])
    result = found(world, world.program)
    assert result.gate is not None
    assert result.gate.outcome is FitOutcome.CORRECTED
    (first, *_) = result.gate.explanations
    winds_up = "a shaft between motor and wheel that winds up"
    assert {first.name, *first.others} == {winds_up, "backlash of the gear"}
    for name, truth in world.truth.items():
        entry = result.parameter(name)
        if entry.identifiable:
            assert entry.low is not None and entry.high is not None
            assert entry.low <= truth <= entry.high, name
    assert result.parameter("sigma_0").identifiable


@pytest.mark.parametrize("amps", [0.0, 0.02])
def test_current_at_rest_makes_its_zero_uncertain(amps: float) -> None:
    world = replace(right("pvc"), program=FEW[:3], at_rest_a=amps)
    trials = world.trials(1)
    parts, _ = sort_out(trials, [sampling_period_s(trial) for trial in trials], Settings())
    shared = rig_system(parts, world.rig, np.array([0.01, 0.1, 0.2, 30.0, 0.2, 2.0])).shared
    (zero,) = [item for item in shared if item.parameter.name == "current_zero"]
    assert zero.u == pytest.approx(math.hypot(3e-3, amps), rel=0.02)


@pytest.mark.parametrize("number", some(range(6), 6))
def test_rig_with_correct_constants_fits(number: int) -> None:
    result = found(control(number), FEW)
    assert result.gate is not None
    assert result.gate.outcome is FitOutcome.FITS, result.gate.sentence


def test_a_constant_on_its_way_is_not_suspected() -> None:
    """A fit that ended on a ridge, two uncertainties of a constant before its optimum."""
    world = replace(right("pvc"), program=FEW[1:])
    trials = world.trials(1)
    parts, _ = sort_out(trials, [sampling_period_s(trial) for trial in trials], Settings())
    q = world.physics
    friction = np.array([q.v_s, q.mu_c, math.log(q.mu_s / q.mu_c), q.s0, q.s1, q.s2])
    system = rig_system(parts, world.rig, friction)
    start = np.array([unknown.parameter.start for unknown in system.shared])
    whole = estimate(system, [start], 50)
    names = [unknown.parameter.name for unknown in system.shared]
    zero = names.index("current_zero")
    scaled = whole.fit.scaled.copy()
    scaled[zero] += 2.0 * system.shared[zero].u
    early = replace(whole.fit, scaled=scaled, theta=to_natural(whole.model.parameters, scaled))
    diagnosis = diagnose(conclude(whole.model, early, 50), lambda _: (), [start], 50, 1e-3)
    assert diagnosis.explanations == ()
    assert diagnosis.left == ()


def test_a_tone_or_jump_in_noise_is_seen() -> None:
    rng = np.random.default_rng(1)
    white = [rng.standard_normal((2000, 2)) for _ in range(5)]
    assert max(levels(white)) < 1.1
    assert loudest_band(white, 1e-3).p_value > 0.005
    assert largest_jump(white).p_value > 0.005
    tone = 0.3 * np.sin(2.0 * math.pi * 50.0 * 1e-3 * np.arange(2000))
    band = loudest_band([part + np.stack([0.0 * tone, tone], 1) for part in white], 1e-3)
    assert band.p_value < 1e-6
    assert band.output == 1
    assert band.low_hz <= 50.0 <= band.high_hz
    white[2][700, 0] = 9.0
    jump: Any = largest_jump(white)
    assert (jump.trial, jump.sample, jump.output) == (2, 700, 0)
    assert jump.p_value < 1e-6


@pytest.mark.parametrize("hum_m", [0.0, 2e-5])
def test_tones_of_counting_are_noise(hum_m: float) -> None:
    """At a steady speed the rounding of an encoder repeats; a hum beside it is still seen."""
    rng, count, samples = np.random.default_rng(3), 3e-5, np.arange(3000)
    white, counted = [], []
    for speed in (3.2e-6, 3.3e-6):  # m in each sample
        hum = hum_m * np.sin(2.0 * math.pi * 0.21 * samples)
        motion = speed * samples + 2e-7 * np.cumsum(rng.standard_normal(3000))
        deviations = _still(len(samples), count)
        whitener = Whitener.of(deviations)
        read = np.rint((motion + hum) / count)[:, None] * count
        predicted = motion[:, None] - read
        white.append(whitener.whiten_errors(predicted))
        counted.append(whitener.counted(read, white[-1]))
    assert loudest_band(white, 1e-3).p_value < 1e-6
    band = loudest_band(white, 1e-3, counted)
    assert (band.p_value < 1e-6) == (hum_m > 0.0)
    if hum_m:
        assert band.low_hz <= 210.0 <= band.high_hz


def _still(samples: int, count: float) -> Deviations:
    """Return one output in counts whose state stays."""
    ones = np.ones((samples, 1, 1))
    variance = np.full((samples, 1), count**2 / 12.0)
    nothing = np.zeros((samples, 1))
    return Deviations(ones, nothing, ones, variance, np.zeros(1), np.eye(1), (count,))


def test_holm_rejects_what_all_tests_allow() -> None:
    assert holm([1e-4, 0.03, 0.02, 0.9], 0.05) == [True, False, False, False]


def test_explanation_that_cannot_be_fitted_leaves_misfit() -> None:
    """The carriage encoder counts the other way in half of the trials."""
    result = found(replace(right("pvc"), turned=2), FEW)
    assert result.gate is not None
    assert result.gate.outcome is FitOutcome.MISFIT
    assert "times what the noise" in result.gate.sentence


def test_constant_is_named_not_a_law_without_size() -> None:
    """Far from the optimum a score test promises most for another law of friction."""
    result = found(replace(right("pvc"), stated={"rolling_resistance": 0.5}), SLOW)
    assert result.gate is not None
    (first, *_) = result.gate.explanations
    assert first.name in ("rolling resistance", "guide friction"), result.gate.sentence
    assert first.stated is not None


def test_guide_that_bears_weight_is_within_intervals() -> None:
    """Half of what the guide rubs, 0.4 % of the weight: sigma_2 was off by 2 half widths."""
    base = right("pvc")
    share = base.rig.guide_friction.value / (base.rig.mass.value * base.rig.gravity.value)
    world = replace(base, physics=base.physics._replace(guide_bears=0.5 * share))
    result = found(world, CONSTANT)
    assert result.gate is not None
    assert result.gate.outcome is FitOutcome.FITS
    for name, truth in world.truth.items():
        entry = result.parameter(name)
        assert entry.low is not None and entry.high is not None, name
        assert entry.low <= truth <= entry.high, name
    assert result.budget["sigma_2"]["what the guide bears"] == pytest.approx(
        share / math.sqrt(3.0), rel=0.01
    )


def test_scale_of_an_encoder_is_named_beside_radius() -> None:
    """A longer measured way is a larger wheel: the data hardly tell which, and both leave g."""
    world = right("stone")
    world = replace(world, guide=replace(world.guide, gain=1.01))
    result = found(world, CONSTANT)
    assert result.gate is not None
    assert result.gate.outcome is FitOutcome.CORRECTED
    (first,) = result.gate.explanations
    assert {first.name, *first.others} == {"wheel radius", "another scale of the carriage encoder"}
    unit, zero = (1.0, 0.0) if first.stated is None else (first.stated, 1.0)
    longer, u = first.size / unit - zero, first.sd / unit
    assert abs(longer - 0.01) < 2.0 * u < 0.005
    stiffness = result.parameter("sigma_0")
    assert stiffness.low is not None and stiffness.high is not None
    assert stiffness.low <= world.physics.s0 <= stiffness.high
