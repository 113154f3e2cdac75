"""Gauges, potentiometers, load cell, card and scale: what they show of a known state."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from support.approach_angle.plant import (
    S,
    history,
    make_plant,
    mean_volts,
    pass_time,
    shipped,
    varied,
)

from rigd_sim.approach_angle import layout
from rigd_sim.approach_angle.acquisition import Acquisition
from rigd_sim.approach_angle.parameters import AngleParameters
from rigd_sim.approach_angle.plant import AnglePlant

SILENT = {"noise": 0.0, "hum": 0.0, "drift": 0.0, "spike": 0.0}


def samples(plant: AnglePlant, seconds: float, **options: object) -> NDArray[np.float64]:
    """Return the volts of the next seconds, shape (n, inputs)."""
    card = Acquisition(plant, start_ns=plant.now_ns, **options)  # type: ignore[arg-type] # by name
    blocks = [card.read_due().volts for _ in range(round(seconds * card.rate_hz / card.block))]
    return np.concatenate(blocks)


def exact(**gauges: object) -> AngleParameters:
    """Return parameters of a rig whose instruments neither disturb nor round."""
    return varied(
        gauges=SILENT | gauges,
        potentiometers={"noise": 0.0},
        load_cell={"noise": 0.0},
        card={"bits": 40},
    )


def test_gauges_show_opposite_halves_of_shear_strain() -> None:
    """gamma = T r/(G J), 24.49 ustrain per N m; +-45 degrees see +-gamma/2."""
    plant = make_plant(noise=False)
    plant.command(True)
    pass_time(plant, 0.3)
    known = history(plant)
    torque = known["torque"]
    assert torque.max() > 1.0
    per_torque = 0.02e6 * 24.49e-6 / 2
    # Bending alike in both, without misalignment, leaves the difference alone.
    np.testing.assert_allclose(
        known["gauge_a_v"] - known["gauge_b_v"], 2 * per_torque * torque, rtol=2e-4, atol=1e-9
    )


def test_misaligned_gauges_see_bending_turn_with_shaft() -> None:
    """eps_x (1 + nu)/2 (sin 2a + sin 2b) cos(angle), eps_x = arm N r/(E I)."""
    plant = make_plant("clean_0", 8.0, 10.0, parameters=exact())
    plant.command(True)
    pass_time(plant, 0.6)
    known, rig = history(plant), plant.individual
    # Twice the 1 degree and the 0.7 degrees of the parameter file.
    twice = np.radians([2.0, 1.4])
    sines, cosine = np.sin(twice).sum(), np.cos(twice).mean()
    scale = 0.02e6 * 0.01 / (26e9 * math.pi / 2 * 0.01**4 * rig.rigidity) * cosine
    eps = 0.012 * known["normal_force"] * 0.01 / (70e9 * math.pi / 4 * 0.01**4)
    phase = known["wheel_angle"] + rig.gauge_phase + plant._run.wheel_offset
    crosstalk = -0.02e6 * eps * (1 + 0.33) / 2 * sines * np.cos(phase)
    shear = known["torque"] * scale
    found = known["gauge_a_v"] / rig.gain_a - known["gauge_b_v"] / rig.gain_b - shear
    assert np.ptp(crosstalk) > 0.015
    np.testing.assert_allclose(found, crosstalk, atol=1e-9)


def test_zeros_drift_between_runs_and_mostly_together() -> None:
    plant = make_plant()
    zeros = []
    for _ in range(300):
        plant.change("platform", "start")
        zeros.append((plant._run.drift_a, plant._run.drift_b))
    a, b = np.array(zeros).T
    assert np.std(a) == pytest.approx(0.4e-6, rel=0.15)
    assert np.std(b) == pytest.approx(0.4e-6, rel=0.15)
    assert np.corrcoef(a, b)[0, 1] == pytest.approx(0.7, abs=0.1)


def test_noise_hum_and_resolution_match_the_parameters() -> None:
    volts = samples(make_plant(), 4.0)
    assert np.array_equal(np.round(volts / (20 / 2**14)), volts / (20 / 2**14))
    times = np.arange(len(volts)) / 9600
    waves = np.column_stack([np.sin(2 * math.pi * 50 * times), np.cos(2 * math.pi * 50 * times)])
    rounding = 20 / 2**14 / math.sqrt(12)
    calm = volts - volts.mean(axis=0)
    for gauge in (0, 1):
        fit = np.linalg.lstsq(waves, calm[:, gauge], rcond=None)[0]
        assert np.hypot(*fit) == pytest.approx(0.3 * 0.02, rel=0.05)
        calm[:, gauge] -= waves @ fit
    expected = [math.hypot(0.8 * 0.02, rounding)] * 2 + [math.hypot(1.5e-3, rounding)] * 2
    np.testing.assert_allclose(calm.std(axis=0), expected, rtol=0.02)
    correlations = np.corrcoef(calm.T) - np.eye(4)
    assert np.abs(correlations).max() < 5 / math.sqrt(len(volts))


def test_with_load_cell_card_loses_bit() -> None:
    volts = samples(make_plant(), 0.5, load_cell=True)
    steps = volts / (20 / 2**13)
    assert volts.shape[1] == 5
    assert np.array_equal(np.round(steps), steps)
    n = 4.0 * 9.81
    assert volts[:, 4].mean() * 20 == pytest.approx(n, rel=0.1)  # 50 mV/N; gain, zero, setting


def test_inputs_are_converted_in_sequence() -> None:
    """On a ramp, each input is a scan of 1/48000 s further than the one before it."""
    plant = make_plant(parameters=exact())
    pass_time(plant, 1.0)
    plant.history[:] = 1e-4 * np.arange(layout.HISTORY_ROWS)[:, np.newaxis]
    card = Acquisition(plant, start_ns=S // 4, load_cell=True)
    volts = card.read_due().volts
    step = 1e-4 * layout.STEPS_PER_S / 48_000
    np.testing.assert_allclose(np.diff(volts, axis=1), step, rtol=1e-4)
    assert volts[0, 0] == pytest.approx(1e-4 * layout.STEPS_PER_S / 4, rel=1e-6)


def test_switching_relay_disturbs_gauges_for_half_millisecond() -> None:
    plant = make_plant(parameters=varied(gauges={**SILENT, "spike": 8e-6}))
    plant.command(True)
    pass_time(plant, 0.009)
    known = history(plant)
    still = known["torque"] == 0.0
    spikes = (known["gauge_a_v"] - known["gauge_a_v"][0])[still]
    assert spikes.max() == pytest.approx(8 * 0.02, rel=0.15)
    assert not spikes[: round(0.008 * layout.STEPS_PER_S)].any(), "nothing before the contact"


def test_potentiometer_has_slope_error_and_cyclic_error() -> None:
    plant = make_plant("clean_0", 4.0, 10.0, parameters=exact())
    plant.command(True)
    pass_time(plant, 0.5)
    known, pots = history(plant), shipped().potentiometers
    start = pots.wheel_start + plant._run.wheel_offset
    angle = known["wheel_angle"] + start
    error = known["wheel_angle_v"] / pots.volts_per_rad - angle
    turns = np.column_stack([angle, np.sin(angle), np.cos(angle)])
    fit, residual = np.linalg.lstsq(turns, error, rcond=None)[:2]
    assert residual[0] / len(error) < 1e-12
    assert 1 + fit[0] == pytest.approx(plant.individual.wheel_slope, abs=1e-9)
    assert np.hypot(*fit[1:]) == pytest.approx(8e-3, rel=1e-6)


def test_a_potentiometer_ends_and_does_not_wrap() -> None:
    plant = make_plant(noise=False)
    plant.change("wheel_lift", "lifted")
    plant.command(True)
    pass_time(plant, 2.0)
    known = history(plant)
    beyond = known["wheel_angle"] + shipped().potentiometers.wheel_start > 20 * math.pi
    assert beyond.any()
    np.testing.assert_allclose(known["wheel_angle_v"][beyond], 5.0, rtol=1e-12)
    assert np.all(np.diff(known["wheel_angle_v"]) >= 0.0)


def test_individuals_differ_within_tolerances_and_repeat() -> None:
    rigs = [make_plant(individual=number).individual for number in range(60)]
    assert rigs[7] == make_plant(individual=7, seed=99).individual
    for name, nominal, spread in (
        ("gain_a", 1.0, 0.003),
        ("rigidity", 1.0, 0.01),
        ("wheel_slope", 1.0, 0.002),
        ("scale_gain", 1.0, 0.002),
        ("arm_deviation_m", 0.0, 0.0005),
    ):
        values = np.array([getattr(rig, name) for rig in rigs])
        assert np.mean(values) == pytest.approx(nominal, abs=4 * spread / math.sqrt(60))
        assert np.std(values) == pytest.approx(spread, rel=0.35)


def readings(plant: AnglePlant, seconds: float) -> list[tuple[float, int]]:
    """Return each reading of the scale of the next seconds."""
    taken, seen = [], plant.scale_readings
    for _ in range(round(seconds / 0.05)):
        pass_time(plant, 0.05)
        if plant.scale_readings > seen:
            seen = plant.scale_readings
            taken.append(plant.scale())
    return taken


def test_slow_scale_calls_only_resting_reading_stable() -> None:
    plant = make_plant()
    settled = readings(plant, 6.0)
    assert len(settled) == 24  # 4 Hz
    assert settled[-1][1] == layout.STABLE
    before = settled[-1][0]
    plant.change("load", 8.0)
    after = readings(plant, 8.0)
    masses = np.array([mass for mass, _ in after])
    at_last = masses[-8:].mean()
    assert at_last == pytest.approx(8.0, rel=0.05)
    # 0.4 s of time constant: after 0.5 s a share of 71 % has come, give or take a reading.
    assert 0.45 < (masses[1] - before) / (at_last - before) < 0.85
    first_stable = next(k for k, (_, status) in enumerate(after) if status == layout.STABLE)
    assert 2.0 < (first_stable + 1) * 0.25 < 6.0
    assert abs(masses[first_stable] - at_last) < 0.04
    np.testing.assert_allclose(masses, np.round(masses, 2), atol=1e-12)  # 10 g


def test_the_scale_shows_an_overload() -> None:
    plant = make_plant()
    plant.change("wheel_lift", "lifted")
    plant.change("scale_weight", 15.5)
    assert readings(plant, 6.0)[-1][1] == layout.OVERLOAD
    plant.change("scale_weight", 14.8)
    assert readings(plant, 6.0)[-1][1] == layout.STABLE


def test_load_set_by_bolts_scatters_on_the_scale() -> None:
    plant = make_plant()
    loads = []
    for _ in range(200):
        plant.change("load", 5.0)
        loads.append(plant._bench.load_n / (5.0 * 9.81))
    assert np.std(loads) == pytest.approx(0.01, rel=0.2)
    readings(plant, 6.0)
    expected = loads[-1] * 5.0 * plant.individual.scale_gain
    assert np.mean([mass for mass, _ in readings(plant, 5.0)]) == pytest.approx(expected, abs=0.01)


def test_ideal_instruments_show_the_state_itself() -> None:
    plant = make_plant("clean_15", 5.0, 7.0, noise=False)
    volts = mean_volts(plant, 0.1)
    p = shipped()
    slope = p.potentiometers.volts_per_rad
    bending = 0.02e6 * 0.012 * 5.0 * 9.81 * 0.01 / p.shaft.bending_stiffness * (1 - 0.33) / 2
    expected = [bending, bending, 5.8 * slope, 0.09 / 0.015 * slope, 5.0 * 9.81 * 0.05]
    np.testing.assert_allclose(volts, expected, rtol=1e-9)
    mass, status = readings(plant, 8.0)[-1]
    assert mass == pytest.approx(5.0, abs=1e-6)
    assert status == layout.STABLE
