"""The physics against the equations of motion, written out once more, and its own refinement."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from support.approach_angle.plant import history, make_plant, pass_time, shipped, truth, varied

from rigd_sim.approach_angle import layout
from rigd_sim.approach_angle.parameters import AngleParameters
from rigd_sim.approach_angle.plant import AnglePlant

STEP_S = 1 / layout.STEPS_PER_S
Floats = NDArray[np.float64]


def integral(values: Floats) -> float:
    return float(np.trapezoid(values, dx=STEP_S))


def driven(plant: AnglePlant, travel_m: float = 0.3) -> dict[str, Floats]:
    """Return the history of a run up to ``travel_m``, from when the platform moves for sure."""
    plant.command(True)
    while truth(plant, "platform_position") < travel_m:
        pass_time(plant, 1e-3)
    known = history(plant)
    moving = slice(int(np.argmax(known["platform_speed"] > 0.1)), None)
    return {name: values[moving] for name, values in known.items()}


@pytest.mark.parametrize("set_name", list(layout.SETS))
@pytest.mark.parametrize(("load_kg", "voltage_v"), [(4.0, 10.0), (8.0, 4.0)])
def test_the_platform_keeps_its_momentum(set_name: str, load_kg: float, voltage_v: float) -> None:
    """m dV = F_r cos(alpha) - F_a sin(alpha) - F_rail, with |F_y| = F_r sin + F_a cos."""
    known = driven(make_plant(set_name, load_kg, voltage_v))
    alpha = math.radians(layout.SETS[set_name][0])
    platform, wheel = shipped().platform, shipped().wheel
    n, rolling, v = known["normal_force"], known["rolling_force"], known["platform_speed"]
    axial = wheel.roller_drag * n if alpha > 0.0 else np.zeros_like(n)
    across = rolling * math.sin(alpha) + axial * math.cos(alpha)
    rail = (
        platform.rail_constant
        + platform.rail_load * (np.abs(n - platform.mass * 9.81) + np.abs(across))
        + platform.rail_viscous * v
    )
    push = rolling * math.cos(alpha) - axial * math.sin(alpha) - rail
    gained = platform.mass * (v[-1] - v[0])
    assert integral(push) == pytest.approx(gained, rel=1e-3)


@pytest.mark.parametrize("set_name", list(layout.SETS))
def test_the_wheel_keeps_its_angular_momentum(set_name: str) -> None:
    """T = I dw/dt + T_b(w, N) + C_rr N R + R_eff F_r, T at the gauges."""
    known = driven(make_plant(set_name, 5.0, 8.5))
    wheel = shipped().wheel
    n, w = known["normal_force"], known["wheel_speed"]
    bearing = wheel.bearing_constant + wheel.bearing_viscous * w + wheel.bearing_load * n
    rolling = wheel.rolling_resistance * n * wheel.radius
    friction = wheel.effective_radius * wheel.radius * known["rolling_force"]
    left = integral(known["torque"] - bearing - rolling - friction)
    gained = wheel.inertia * (w[-1] - w[0])
    assert left == pytest.approx(gained, abs=1e-4 * integral(known["torque"]))


def test_sliding_speed_uses_effective_radius_in_rolling_direction() -> None:
    known = driven(make_plant("clean_30", 4.0, 7.0))
    radius = shipped().wheel.radius * shipped().wheel.effective_radius
    expected = radius * known["wheel_speed"] - known["platform_speed"] * math.cos(math.pi / 6)
    np.testing.assert_allclose(known["sliding_speed"], expected, atol=1e-12)


def test_friction_peaks_at_half_metre_per_second() -> None:
    """The curve of each set, after breakaway, has its maximum at that of the parameters."""
    for name in layout.SETS:
        plant = make_plant(name, 4.0, 10.0, noise=False)
        known = driven(plant)
        late = slice(-2000, None)  # the breakaway surplus is gone
        sliding, limit = known["sliding_speed"][late], known["friction_limit"][late]
        published = getattr(shipped().limits, name)
        assert limit.max() <= published * (1 + 1e-6)
        decades = np.log10((np.abs(sliding) + 1e-3) / (0.5 + 1e-3))
        np.testing.assert_allclose(limit, published * np.exp(-0.08 * decades**2), rtol=1e-6)


def test_halved_step_changes_speeds_below_tolerance() -> None:
    # The relay acts at a step; a quarter of a step aside, both grids see it at the same times.
    step = STEP_S
    relay: dict[str, object] = {"pick_up": 149.75 * step, "bounce": 40 * step}
    speeds = {}
    for set_name, load_kg, voltage_v in (("clean_0", 4.0, 10.0), ("clean_45", 8.0, 4.0)):
        for finer in (1, 2):
            plant = make_plant(set_name, load_kg, voltage_v, parameters=varied(relay=relay))
            state = plant._state
            state["command"] = 1.0
            rows = np.zeros((8193 * finer, len(layout.HISTORY)))
            plant._kernel.advance(
                plant._constants, state, rows, plant._scale, 1, 0, 8192 * finer, step / finer
            )
            speeds[finer] = rows[::finer, layout.HISTORY.index("platform_speed")]
        assert speeds[1].max() > 0.8
        assert np.abs(speeds[1] - speeds[2]).max() < 1e-4


def test_motor_on_10_v_has_published_figures() -> None:
    ideal = varied(motor={"source_resistance": 0.0, "gearbox_drag": 0.0})
    stalled = make_plant(parameters=ideal)
    stalled.change("wheel_lift", "lifted")
    stalled.change("shaft", "clamped")
    stalled.command(True)
    pass_time(stalled, 0.1)
    current = float(stalled._state["i"][0])
    assert current * ideal.motor.torque_per_current == pytest.approx(13.0, rel=0.005)

    free = make_plant(parameters=ideal, drag=False)
    free.change("wheel_lift", "lifted")
    free.command(True)
    pass_time(free, 1.0)
    assert truth(free, "wheel_speed") == pytest.approx(45.0, rel=0.005)


def contact(plant: AnglePlant, command: bool, seconds: float) -> list[tuple[float, bool]]:
    """Return when after ``command`` the contact changed, in s, and to what."""
    plant.command(command)
    began, closed, changes = plant.now_ns, plant.closed, []
    while plant.now_ns < began + seconds * 1e9:
        pass_time(plant, STEP_S)
        if plant.closed != closed:
            closed = plant.closed
            changes.append(((plant.now_ns - began) * 1e-9, closed))
    return changes


def test_relay_closes_late_and_bounces_and_opens_late() -> None:
    plant = make_plant()
    closing = contact(plant, True, 0.02)
    assert [closed for _, closed in closing] == [True, False, True, False, True]
    assert closing[0][0] == pytest.approx(8e-3, abs=3 * STEP_S)
    assert closing[-1][0] == pytest.approx(8e-3 + 0.75 * 1.6e-3, abs=3 * STEP_S)
    opening = contact(plant, False, 0.02)
    assert [closed for _, closed in opening] == [False]
    assert opening[0][0] == pytest.approx(6e-3, abs=3 * STEP_S)


def test_relay_commanded_back_in_time_does_not_move() -> None:
    plant = make_plant()
    assert contact(plant, True, 4e-3) == contact(plant, False, 20e-3) == []
    assert truth(plant, "wheel_speed") == 0.0
    assert len(contact(plant, True, 20e-3)) == 5
    assert contact(plant, False, 3e-3) == contact(plant, True, 20e-3) == []


def test_the_shaft_carries_nothing_within_the_backlash() -> None:
    plant = make_plant(noise=False)
    plant.command(True)
    gap, within, beyond = shipped().shaft.backlash, 0, 0
    for _ in range(600):
        pass_time(plant, STEP_S)
        twist = float((plant._state["rotor"] - plant._state["wheel"])[0])
        if abs(twist) <= gap:
            within += 1
            assert truth(plant, "torque") == 0.0
        else:
            beyond += 1
            assert truth(plant, "torque") >= 0.0
    assert within > 150
    assert beyond > 100


@pytest.mark.parametrize("load_kg", [4.0, 5.0, 6.0, 8.0])
@pytest.mark.parametrize("set_name", list(layout.SETS))
def test_opened_relay_lets_platform_coast_to_its_bumper(set_name: str, load_kg: float) -> None:
    plant = make_plant(set_name, load_kg, 4.0)
    driven(plant)
    plant.command(False)
    while not plant.resting:
        pass_time(plant, 0.05)
    assert history(plant)["platform_position"].max() > shipped().platform.bumper


@pytest.mark.parametrize(("brake", "low_m", "high_m"), [(False, 0.35, 2.5), (True, 0.06, 0.36)])
def test_without_bumper_platform_coasts_and_shorted_motor_brakes(
    brake: bool, low_m: float, high_m: float
) -> None:
    """angle.md §4.6 has 0.5 to 2.5 m and, with a brake contact, 0.09 to 0.36 m."""
    parameters: AngleParameters = varied(relay={"brake": brake}, platform={"bumper": 9.0})
    for set_name, load_kg, voltage_v in (("clean_0", 4.0, 10.0), ("clean_45", 8.0, 4.0)):
        plant = make_plant(set_name, load_kg, voltage_v, parameters=parameters)
        driven(plant)
        start = truth(plant, "platform_position")
        plant.command(False)
        while not plant.resting:
            pass_time(plant, 0.05)
        assert low_m < truth(plant, "platform_position") - start < high_m


def test_resting_rig_stays_in_place_without_creep() -> None:
    plant = make_plant("clean_45", 8.0, 10.0)
    driven(plant)
    plant.command(False)
    while not plant.resting:
        pass_time(plant, 0.05)
    before = plant.truth
    pass_time(plant, 3.0)
    assert plant.truth == before
    assert truth(plant, "platform_speed") == truth(plant, "wheel_speed") == 0.0


def test_normal_force_vibrates_at_rollers_except_without_noise() -> None:
    known = driven(make_plant("clean_0", 4.0, 10.0))
    late = slice(-4096, None)
    n = known["normal_force"][late] - np.mean(known["normal_force"][late])
    spectrum = np.abs(np.fft.rfft(n * np.hanning(n.size)))
    strongest = np.fft.rfftfreq(n.size, STEP_S)[10 + int(np.argmax(spectrum[10:]))]
    roller_hz = 18 * np.mean(known["wheel_speed"][late]) / (2 * math.pi)
    assert strongest == pytest.approx(roller_hz, rel=0.06)
    calm = driven(make_plant("clean_0", 4.0, 10.0, noise=False))
    np.testing.assert_allclose(calm["normal_force"], 4.0 * 9.81, rtol=1e-12)


def smooth_wheel(**changed: float) -> AngleParameters:
    """Return parameters of a rig whose normal force does not vibrate, and varies as given only."""
    still = dict.fromkeys(
        ("profile_rollers", "profile_sides", "rise", "rise_spread", "tilting", "relaxation"), 0.0
    )
    return varied(normal_force={**still, **changed})


def test_normal_force_rises_along_travel_and_with_traction() -> None:
    """N = N_0 (1 + 0.03 x/(0.3 m)) + 0.02 F_r."""
    plant = make_plant("clean_45", parameters=smooth_wheel(rise=0.03, tilting=0.02))
    at_rest = truth(plant, "normal_force")
    known = driven(plant)
    expected = at_rest * (1.0 + 0.1 * known["platform_position"]) + 0.02 * known["rolling_force"]
    np.testing.assert_allclose(known["normal_force"], expected, rtol=1e-9)
    assert np.ptp(known["normal_force"]) > 0.02 * at_rest


def test_the_surface_relaxes_from_when_it_is_driven() -> None:
    """By a hundredth, with a time constant of 0.2 s, 8 ms after the command."""
    plant = make_plant(parameters=smooth_wheel(relaxation=0.01))
    pass_time(plant, 1.0)
    at_rest = truth(plant, "normal_force")
    plant.command(True)
    pass_time(plant, 0.208)
    assert truth(plant, "normal_force") / at_rest - 1.0 == pytest.approx(
        0.01 * math.expm1(-1.0), rel=1e-3
    )
