"""What a calibration does to the plant: clamped shaft with an arm, lifted wheel, push, weights."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.approach_angle.plant import (
    history,
    make_plant,
    mean_volts,
    pass_time,
    shipped,
    truth,
    varied,
)

from rigd_sim.approach_angle import layout
from rigd_sim.approach_angle.plant import AnglePlant


def on_the_bench(**options: object) -> AnglePlant:
    plant = make_plant(**options)  # type: ignore[arg-type] # by name
    plant.change("wheel_lift", "lifted")
    return plant


def test_weight_on_clamped_arm_gives_torque_scale() -> None:
    """K_T = m g L / d(V_a - V_b), and what the arm's bending adds to a misaligned pair."""
    plant = on_the_bench()
    plant.change("shaft", "clamped")
    zero = mean_volts(plant, 2.0)
    plant.change("arm_mass", 3.0)
    loaded = mean_volts(plant, 2.0)
    assert truth(plant, "torque") == pytest.approx(6.0, rel=0.01)
    gained = (loaded - zero)[0] - (loaded - zero)[1]
    found = 3 * 9.81 * shipped().calibration_arm.length / gained
    assert found == pytest.approx(plant.torque_scale, rel=3e-3)
    assert found == pytest.approx(2.0416, rel=0.04)  # N m/V as drawn
    plant.change("arm_mass", 0.0)
    np.testing.assert_allclose(mean_volts(plant, 2.0)[:2], zero[:2], atol=1e-3)


def test_the_weight_bends_the_shaft_downwards() -> None:
    """Common to both gauges: eps_x (1 - nu)/2, opposite to the wheel's load."""
    plant = on_the_bench(noise=False)
    plant.change("shaft", "clamped")
    common = []
    for mass in (0.0, 3.0):
        plant.change("arm_mass", mass)
        pass_time(plant, 1e-3)
        common.append(mean_volts(plant, 0.1)[:2].mean())
    p = shipped()
    eps = 3 * 9.81 * p.shaft.bend_arm * p.shaft.radius / p.shaft.bending_stiffness
    expected = -p.gauges.sensitivity * eps * (1 - p.shaft.poisson) / 2
    assert common[1] - common[0] == pytest.approx(expected, rel=1e-6)


def test_freeing_the_clamped_shaft_removes_the_weight() -> None:
    plant = on_the_bench()
    plant.change("shaft", "clamped")
    plant.change("arm_mass", 3.0)
    plant.command(True)
    pass_time(plant, 0.5)
    assert truth(plant, "wheel_speed") == truth(plant, "wheel_angle") == 0.0
    assert truth(plant, "torque") == pytest.approx(6.0, rel=0.01)
    plant.command(False)
    plant.change("shaft", "free")
    pass_time(plant, 0.5)
    assert truth(plant, "torque") == 0.0
    assert plant._bench.arm_mass == 0.0


def test_lifted_wheel_shows_friction_of_its_bearings() -> None:
    plant = on_the_bench(voltage_v=4.0)
    plant.command(True)
    pass_time(plant, 2.0)
    wheel, speed = shipped().wheel, truth(plant, "wheel_speed")
    assert speed > 15.0
    expected = wheel.bearing_constant + wheel.bearing_viscous * speed
    assert truth(plant, "torque") == pytest.approx(expected, rel=1e-3)
    assert truth(plant, "normal_force") == truth(plant, "rolling_force") == 0.0


def test_a_pushed_platform_is_slowed_by_its_rails() -> None:
    """m dV/dt = -(c0 + c_N |0 - m g| + c_v V) with the wheel lifted."""
    plant = on_the_bench()
    plant.change("push", 0.5)
    pass_time(plant, 0.6)
    known = history(plant)
    x, v = known["platform_position"][1:], known["platform_speed"][1:]
    rails, mass = shipped().platform, shipped().platform.mass
    drag = rails.rail_constant + rails.rail_load * mass * 9.81 + rails.rail_viscous * v
    lost = np.trapezoid(drag, dx=1 / 19_200)
    assert v[0] == pytest.approx(0.5, rel=1e-3)
    assert mass * (v[0] - v[-1]) == pytest.approx(lost, rel=1e-3)
    assert x[-1] < rails.bumper


@pytest.mark.parametrize(("set_name", "lift"), [("clean_0", "down"), ("clean_45", "down"),
                                               ("clean_0", "lifted")])  # fmt: skip
def test_platform_pushed_to_end_rests_and_turns_wheel(set_name: str, lift: str) -> None:
    plant = make_plant(set_name, parameters=varied(normal_force={"rise_spread": 0.0}))
    plant.change("wheel_lift", lift)
    pass_time(plant, 0.1)
    before = plant.history[plant.steps % layout.HISTORY_ROWS].copy()
    plant.change("platform", "end")
    pass_time(plant, 0.1)
    gained = dict(
        zip(layout.HISTORY, plant.history[plant.steps % layout.HISTORY_ROWS] - before, strict=True)
    )
    travel = 0.3 * math.cos(math.radians(layout.SETS[set_name][0])) if lift == "down" else 0.0
    assert plant.resting
    assert gained["platform_position"] == pytest.approx(0.3)
    assert gained["wheel_angle"] == pytest.approx(travel / (0.995 * 0.05))
    rise = 0.0 if lift == "lifted" else 0.03 * before[layout.HISTORY.index("normal_force")]
    assert gained["normal_force"] == pytest.approx(rise, abs=1e-9)
    pots = shipped().potentiometers
    volts = 0.3 / pots.pulley * pots.volts_per_rad
    assert gained["platform_position_v"] == pytest.approx(volts, rel=0.01)
    plant.command(True)
    pass_time(plant, 0.1)
    assert (truth(plant, "wheel_speed") > 1.0) and not plant.resting


def test_lifted_platform_is_brought_where_asked() -> None:
    plant = on_the_bench()
    pass_time(plant, 0.1)
    plant.change("platform_at", 0.047)
    pass_time(plant, 0.1)
    assert plant.resting
    assert truth(plant, "platform_position") == pytest.approx(0.047)
    assert truth(plant, "wheel_angle") == 0.0
    plant.change("push", 0.3)
    pass_time(plant, 0.3)
    assert truth(plant, "platform_position") > 0.1


def test_known_weights_show_the_gain_of_the_scale() -> None:
    plant = on_the_bench()
    shown = []
    for mass in (0.0, 5.0, 10.0):
        plant.change("scale_weight", mass)
        pass_time(plant, 6.0)
        taken = []
        for _ in range(40):
            pass_time(plant, 0.25)
            taken.append(plant.scale()[0])
        shown.append(float(np.mean(taken)))
    gain = plant.individual.scale_gain
    expected = [0.0, 5.0 * gain, 10.0 * gain]
    assert shown == pytest.approx(expected, abs=4 * math.hypot(8e-3, 3e-3) / math.sqrt(40))
