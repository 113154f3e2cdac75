"""The plant as a rig uses it: time, determinism, sensors, end stops, changes at the bench."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from rigd_sim.lugre import layout
from rigd_sim.lugre.parameters import LugreParameters
from rigd_sim.lugre.plant import LugrePlant

MakePlant = Callable[..., LugrePlant]
MS = 1_000_000
BELT_SPEED, BELT_ENGAGED = layout.BELT_COMMANDS, layout.BELT_COMMANDS + 1
LATERAL_SPEED = layout.LATERAL_COMMANDS
X = layout.READINGS.index("carriage_position")
V = layout.READINGS.index("carriage_speed")


def shown_bit_v(make_plant: MakePlant) -> float:
    return make_plant().parameters.sensors.card_resolution


def drive(plant: LugrePlant, current: float) -> None:
    plant.commands[layout.WHEEL_ENABLED] = 1.0
    plant.commands[layout.WHEEL_CURRENT] = current
    plant.commands[BELT_ENGAGED] = 0.0


def play(
    plant: LugrePlant, cycles: int, *, start_ms: int = 0, every_ms: int = 1
) -> NDArray[np.float64]:
    """Return the readings of ``cycles`` cycles, shape (cycles, readings)."""
    times = (start_ms + n * every_ms for n in range(1, cycles + 1))
    return np.array([plant.readings_at(t * MS) for t in times])


def test_a_seed_repeats_bit_for_bit(make_plant: MakePlant) -> None:
    runs = []
    for seed in (3, 3, 4):
        plant = make_plant(seed=seed)
        plant.advance(0)
        drive(plant, 1.05)
        runs.append(play(plant, 300))
    assert runs[0].tobytes() == runs[1].tobytes()
    assert not np.array_equal(runs[0], runs[2])
    hidden = slice(layout.TRUTH_READINGS, None)
    assert np.array_equal(runs[0][:, hidden], runs[2][:, hidden]), "noise must not act on physics"


def test_individual_rigs_differ_in_phases_starts_and_zeros(make_plant: MakePlant) -> None:
    counts = [layout.READINGS.index(name) for name in ("motor_counts", "guide_counts")]
    rows, volts = [], []
    for number in (0, 1, 1, 2, 3):
        plant = make_plant(individual=number)
        plant.advance(0)
        rows.append([plant.readings[index] for index in counts])
        volts.append(play(plant, 2000)[:, [layout.ACCELERATION_VOLTS, layout.CURRENT_VOLTS]])
    assert rows[0] == [0, 0]
    assert rows[1] == rows[2]
    assert len({tuple(row) for row in rows}) == 4
    # At the start within 2 mm: 65 counts.
    assert all(abs(row[1]) <= 66 for row in rows)
    zeros = np.array([volt.mean(axis=0) for volt in volts]) / shown_bit_v(make_plant)
    np.testing.assert_array_equal(zeros[1], zeros[2])
    apart = np.abs(zeros[[1, 3, 4]] - zeros[0])
    assert np.all((apart > 0.01) & (apart < 0.6)), apart


def test_physics_and_noise_ignore_division_of_time(make_plant: MakePlant) -> None:
    fine, coarse = make_plant(), make_plant()
    for plant in (fine, coarse):
        plant.advance(0)
        drive(plant, 1.2)
    hidden = slice(layout.TRUTH_READINGS, None)
    often, seldom = play(fine, 210)[6::7], play(coarse, 30, every_ms=7)
    np.testing.assert_allclose(often[:, hidden], seldom[:, hidden], rtol=1e-11, atol=1e-15)
    volts = [layout.ACCELERATION_VOLTS, layout.CURRENT_VOLTS]
    assert np.array_equal(often[:, volts], seldom[:, volts])


def test_the_first_call_sets_the_origin_of_time(make_plant: MakePlant) -> None:
    early, late = make_plant(), make_plant()
    early.advance(0)
    late.advance(1_800_000_000_000_000_000)
    assert late.readings == early.readings
    for plant in (early, late):
        drive(plant, 0.9)
    assert early.readings_at(20 * MS) == late.readings_at(1_800_000_000_000_000_000 + 20 * MS)


def test_repeated_time_does_nothing_and_earlier_is_refused(make_plant: MakePlant) -> None:
    plant = make_plant()
    plant.advance(5 * MS)
    before = plant.readings
    plant.advance(5 * MS)
    assert plant.readings is before
    with pytest.raises(ValueError, match="cannot go back to 4000000"):
        plant.advance(4 * MS)


def test_sensors_are_quantised_and_unbiased(
    make_plant: MakePlant, parameters: LugreParameters
) -> None:
    plant = make_plant(seed=5)
    plant.advance(0)
    rest = play(plant, 4000)
    drive(plant, 1.2)
    rows = play(plant, 800, start_ms=4000)
    truth = {name: rows[:, layout.READINGS.index(name)] for name, _, _ in layout.TRUTH}

    counts = rows[:, [layout.MOTOR_COUNTS, layout.GUIDE_COUNTS]]
    assert np.array_equal(counts, np.round(counts))
    guide = counts[:, 1] * parameters.sensors.guide_resolution - truth["carriage_position"]
    assert np.abs(guide).max() <= 0.5000001 * parameters.sensors.guide_resolution
    assert np.mean(guide) == pytest.approx(0.0, abs=0.1 * parameters.sensors.guide_resolution)

    monitor = parameters.sensors.current_monitor
    volts = rows[:, layout.CURRENT_VOLTS]
    card = volts / parameters.sensors.card_resolution
    assert np.array_equal(card, np.round(card))
    error = volts / monitor.sensitivity - truth["motor_current"]
    spread = np.hypot(monitor.noise, 0.00305 / np.sqrt(12))
    assert np.mean(error) == pytest.approx(0.0, abs=4 * spread / np.sqrt(error.size))
    assert np.std(error) == pytest.approx(spread, rel=0.1)

    accelerometer = parameters.sensors.accelerometer
    volts = rest[:, layout.ACCELERATION_VOLTS]
    card = volts / parameters.sensors.card_resolution
    assert np.array_equal(card, np.round(card))
    felt = volts / accelerometer.sensitivity
    assert np.mean(felt) == pytest.approx(accelerometer.bias, abs=4 * 0.03 / np.sqrt(4000))
    assert np.std(felt) == pytest.approx(accelerometer.noise, rel=0.1)


def test_ideal_sensors_show_the_truth(make_plant: MakePlant, parameters: LugreParameters) -> None:
    plant = make_plant(noise=False, vibration=False)
    plant.advance(0)
    drive(plant, 1.2)
    rows = play(plant, 500)
    sensors = parameters.sensors
    x = rows[:, layout.GUIDE_COUNTS] * sensors.guide_resolution
    np.testing.assert_allclose(x, rows[:, X], rtol=1e-12)
    current = rows[:, layout.CURRENT_VOLTS] / sensors.current_monitor.sensitivity
    np.testing.assert_allclose(current, rows[:, layout.READINGS.index("motor_current")], rtol=1e-12)
    acceleration = rows[:, layout.ACCELERATION_VOLTS] / sensors.accelerometer.sensitivity
    slope = np.gradient(rows[:, V], 1e-3)
    np.testing.assert_allclose(acceleration[20:-1], slope[20:-1], atol=0.01)


def test_vibration_shakes_at_the_roller_transitions(make_plant: MakePlant) -> None:
    """The accelerometer of a vibrating plant differs from that of a calm one at 18 and 36 theta."""
    series = []
    for vibration in (True, False):
        plant = make_plant(noise=False, vibration=vibration)
        plant.advance(0)
        drive(plant, 1.2)
        series.append(play(plant, 800))
    shaking = series[0][:, layout.ACCELERATION_VOLTS] / 0.102
    calm = series[1][:, layout.ACCELERATION_VOLTS] / 0.102
    shake = (shaking - calm)[300:] / series[0][300:, V]
    angle = series[0][300:, layout.MOTOR_COUNTS] * 2 * np.pi / (1024 * 20.25)
    turns = np.column_stack([f(k * angle) for k in (18, 36) for f in (np.sin, np.cos)])
    fit = np.linalg.lstsq(turns, shake, rcond=None)[0].reshape(2, 2)
    assert np.hypot(*fit.T) == pytest.approx([0.30, 0.15], rel=0.15)


def test_rig_at_rest_with_belt_does_not_drift(make_plant: MakePlant) -> None:
    plant = make_plant()
    plant.advance(0)
    rows = play(plant, 5000)
    assert not rows[:, layout.TRUTH_READINGS :].any()


def test_the_belt_brakes_and_brings_the_carriage_back(make_plant: MakePlant) -> None:
    plant = make_plant(noise=False)
    plant.advance(0)
    drive(plant, 1.35)
    away = play(plant, 900)
    assert away[-1, V] > 1.8
    plant.commands[layout.WHEEL_CURRENT] = 0.0
    plant.commands[BELT_ENGAGED] = 1.0
    braked = play(plant, 600, start_ms=900)
    assert abs(braked[-1, V]) < 3e-3
    assert braked[:, X].max() - away[-1, X] < 0.15
    plant.commands[BELT_SPEED] = -0.5
    back = play(plant, 1500, start_ms=1500)
    assert back[1000, V] == pytest.approx(-0.5, abs=0.005)
    force = back[:, layout.BELT_READINGS + 2]
    assert np.abs(force).max() <= 80.0


def test_a_released_clutch_gives_no_force(make_plant: MakePlant) -> None:
    plant = make_plant(noise=False)
    plant.advance(0)
    plant.commands[BELT_ENGAGED] = 0.0
    plant.commands[BELT_SPEED] = 0.5
    rows = play(plant, 300)
    assert not rows[:, X].any()
    assert not rows[:, layout.BELT_READINGS + 2].any()


def test_a_runaway_ends_in_the_end_stop(make_plant: MakePlant) -> None:
    plant = make_plant(mass="1.9593 kg")
    plant.advance(0)
    drive(plant, 1.5)
    rows = play(plant, 6000)
    assert np.isfinite(rows).all()
    assert 1.75 < rows[:, X].max() < 1.85
    assert abs(rows[-1, V]) < 0.02
    assert int(rows[-1, layout.BELT_READINGS + 3]) & layout.BELT_AT_END_STOP


def test_lateral_servo_holds_speed_with_its_sign(make_plant: MakePlant) -> None:
    """Moving across makes the carriage faster for v_z > 0 and slower for v_z < 0 (section 4)."""
    speeds = {}
    for lateral in (0.0, 0.35, -0.35):
        plant = make_plant(noise=False, vibration=False)
        plant.advance(0)
        # The negative direction begins at the far side of the workspace.
        plant.commands[LATERAL_SPEED] = 0.5 if lateral < 0 else 0.0
        play(plant, 1150)
        plant.commands[LATERAL_SPEED] = lateral
        play(plant, 300, start_ms=1150)
        drive(plant, 0.6)
        rows = play(plant, 500, start_ms=1450)
        across = rows[:, layout.READINGS.index("lateral_speed")]
        assert across == pytest.approx(lateral, abs=0.02)
        speeds[lateral] = rows[-1, V]
    assert speeds[0.35] - speeds[0.0] > 0.02
    assert speeds[0.0] - speeds[-0.35] > 0.02


def test_a_bridge_that_was_moved_comes_to_rest(make_plant: MakePlant) -> None:
    """Exactly to rest: a tail that never ends would slow every later cycle down."""
    plant = make_plant()
    plant.advance(0)
    plant.commands[LATERAL_SPEED] = 0.35
    play(plant, 500)
    plant.commands[LATERAL_SPEED] = 0.0
    across = play(plant, 30_000, start_ms=500)[:, layout.READINGS.index("lateral_speed")]
    assert np.abs(across[1000:]).max() < 3e-3
    assert across[-1] == 0.0


def test_small_currents_creep_on_stone_stick_on_pvc(make_plant: MakePlant) -> None:
    travelled = {}
    for floor in ("stone", "pvc"):
        plant = make_plant(floor=floor, noise=False, vibration=False)
        plant.advance(0)
        drive(plant, 0.15)
        travelled[floor] = play(plant, 4000)[-1, X]
    assert travelled["stone"] > 0.01
    assert travelled["pvc"] < 0.005


def test_a_change_of_floor_or_mass_acts(make_plant: MakePlant) -> None:
    changed, fresh = make_plant(), make_plant(floor="pvc", mass="1.9593 kg")
    changed.change("floor", "pvc")
    changed.change("mass", 1.9593)
    for plant in (changed, fresh):
        plant.advance(0)
        drive(plant, 1.2)
    assert play(changed, 200).tobytes() == play(fresh, 200).tobytes()


@pytest.mark.parametrize(
    ("quantity", "value", "message"),
    [
        ("flour", "pvc", "no 'flour'; it can change floor, mass"),
        ("floor", "ice", "floor cannot be 'ice': it takes stone, pvc, paperboard"),
        ("floor", 3.0, "floor cannot be 3.0"),
        ("mass", 0.1, "mass cannot be 0.1 kg: it takes 0.5 kg to 20 kg"),
        ("mass", float("nan"), "mass cannot be nan kg"),
        ("mass", "heavy", "mass cannot be 'heavy'"),
    ],
)
def test_an_impossible_change_is_refused(
    make_plant: MakePlant, quantity: str, value: float | str, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        make_plant().change(quantity, value)
