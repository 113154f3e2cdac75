"""The mechanism against closed forms, and against another integrator with equations of its own."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk
from support.mechanisms import MS, at, command, force_in, over_time, plant_of

CHAIN = """
    bodies:
      left: {mass: 2 kg, speed: 0.5 m/s}
      middle: {mass: 1 kg}
      right: {mass: 3 kg, start: 1 m}
    springs:
      one: {between: [left, ground], stiffness: 800 N/m, damping: 2 N s/m}
      two: {between: [middle, left], stiffness: 500 N/m}
      three: {between: [right, middle], stiffness: 1200 N/m, damping: 1 N s/m}
    friction:
      slide:
        between: [left, ground]
        load: 10 N
        law: {kind: stribeck, coulomb: 0.1, static: 0.15, stribeck_speed: 50 mm/s,
              smooth: 10 mm/s, viscous: 0.2 s/m}
      rub:
        between: [middle, right]
        load: 10 N
        law: {kind: lugre, coulomb: 0.1, static: 0.15, stribeck_speed: 50 mm/s, sigma_0: 2000 1/m,
              sigma_1: 5 s/m, viscous: 0.1 s/m}
      drag: {between: [right, ground], law: {kind: viscous, viscous: 0.5 N s/m}}
"""


def chain_rates(_: float, y: np.ndarray) -> list[float]:
    """Return the rates of the chain, written out by hand."""
    x1, x2, x3, v1, v2, v3, z = y

    def g(v: float) -> float:
        return 0.1 + 0.05 * math.exp(-((v / 0.05) ** 2))

    first, two = 800 * x1 + 2 * v1, 500 * (x2 - x1)
    three = 1200 * (x3 - x2) + (v3 - v2)
    slide = 10 * (g(v1) * math.tanh(v1 / 0.01) + 0.2 * v1)
    slip = v2 - v3
    bend = slip - 2000 * abs(slip) * z / g(slip)
    rub = 10 * (2000 * z + 5 * bend + 0.1 * slip)
    return [
        v1, v2, v3, (two - first - slide) / 2, three - two - rub, (rub - three - 0.5 * v3) / 3, bend
    ]  # fmt: skip


def test_chain_is_within_1e_6_of_solve_ivp(tmp_path: Path) -> None:
    positions, speeds = over_time(plant_of(tmp_path, CHAIN), ["left", "middle", "right"], 1.0)
    reference = solve_ivp(
        chain_rates, (0, 1), [0, 0, 0, 0.5, 0, 0, 0], method="DOP853", rtol=1e-11, atol=1e-13,
        max_step=1e-3, t_eval=np.arange(1001) * 1e-3,
    ).y  # fmt: skip
    ours = np.concatenate([positions - positions[:, :1], speeds])
    error = np.abs(ours - reference[:6]).max(axis=1) / np.ptp(reference[:6], axis=1)
    assert error.max() < 1e-6


@pytest.mark.parametrize("step", [1e-3, 5e-4])
def test_error_falls_with_fourth_power_of_step(tmp_path: Path, step: float) -> None:
    text = """
        step: {step} ms
        bodies: {a: {mass: 1 kg, speed: 1 m/s}}
        springs: {s: {between: [a, ground], stiffness: 40000 N/m, damping: 4 N s/m}}
    """.replace("{step}", "STEP")
    errors = []
    for parts in (1, 2):
        plant = plant_of(tmp_path, text.replace("STEP", "1"))
        plant._step_ns = step * 1e9 / parts
        x, _ = over_time(plant, ["a"], 0.2)
        t = np.arange(201) * 1e-3
        w = math.sqrt(40000 - 4)
        errors.append(np.abs(x[0] - np.exp(-2 * t) * np.sin(w * t) / w).max())
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.4)


def test_oscillator_decays_as_its_closed_form(tmp_path: Path) -> None:
    plant = plant_of(
        tmp_path,
        """
        bodies: {a: {mass: 2 kg, speed: 1 m/s}}
        springs: {s: {between: [a, ground], stiffness: 200 N/m, damping: 4 N s/m}}
        """,
    )
    x, _ = over_time(plant, ["a"], 1.0)
    t, w = np.arange(1001) * 1e-3, math.sqrt(100 - 1)
    assert np.abs(x[0] - np.exp(-t) * np.sin(w * t) / w).max() < 1e-9


def test_large_swing_has_the_elliptic_period(tmp_path: Path) -> None:
    plant = plant_of(
        tmp_path,
        """
        bodies: {shaft: {inertia: 0.5 kg m^2, start: 120 deg}}
        pendulums: {bob: {body: shaft, mass: 2 kg, arm: 0.5 m}}
        """,
    )
    start = math.radians(120)
    period = 4 * math.sqrt(0.5 / 9.81) * float(ellipk(math.sin(start / 2) ** 2))
    plant.advance(0)
    plant.advance(round(period * 1e9))
    assert at(plant, "shaft")[0] == pytest.approx(start, abs=1e-9)
    assert abs(at(plant, "shaft")[1]) < 1e-7


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_stick_slip_begins_where_friction_falls_faster(tmp_path: Path, share: float) -> None:
    """A slider on a belt: the linear limit is d = N |dmu/dv|, and the rate is half the rest."""
    falls = 20 * 0.1 / 0.05 * math.exp(-0.1 / 0.05)  # N s/m, of a law with exponent 1
    steady = 20 * (0.2 + 0.1 * math.exp(-0.1 / 0.05))
    plant = plant_of(
        tmp_path,
        f"""
        bodies: {{belt: {{mass: 1e5 kg, speed: 0.1 m/s}}, slider: {{mass: 1 kg}}}}
        springs:
          cell: {{between: [slider, ground], stiffness: 2000 N/m, damping: {share * falls} N s/m,
                  preload: {steady + 0.05} N}}
        friction:
          contact:
            between: [belt, slider]
            load: 20 N
            law: {{kind: stribeck, coulomb: 0.2, static: 0.3, stribeck_speed: 50 mm/s, exponent: 1}}
        """,
    )
    _, v = over_time(plant, ["slider"], 4.0)
    grown = np.ptp(v[0, 3500:]) / np.ptp(v[0, :500])
    assert math.log(grown) / 3.5 == pytest.approx((1 - share) * falls / 2, abs=0.03)


def test_bristles_hold_a_load_without_creep(tmp_path: Path) -> None:
    plant = plant_of(
        tmp_path,
        """
        bodies: {block: {mass: 1 kg, slope: 10 deg}}
        friction:
          floor:
            between: [block, ground]
            load: 1 kg
            law: {kind: lugre, coulomb: 0.2, static: 0.3, stribeck_speed: 10 mm/s,
                  sigma_0: 10000 1/m, sigma_1: 30 s/m}
        """,
    )
    plant.advance(0)
    plant.advance(2000 * MS)
    before = at(plant, "block")[0]
    plant.advance(12000 * MS)
    assert at(plant, "block")[0] == pytest.approx(before, abs=1e-10)
    assert force_in(plant, "floor") == pytest.approx(-9.81 * math.sin(math.radians(10)), rel=1e-6)


def test_bristles_let_go_beyond_static_friction(tmp_path: Path) -> None:
    plant = plant_of(
        tmp_path,
        """
        bodies: {block: {mass: 2 kg}}
        friction:
          floor:
            between: [block, ground]
            load: 2 kg
            law: {kind: lugre, coulomb: 0.2, static: 0.3, stribeck_speed: 10 mm/s,
                  sigma_0: 10000 1/m, sigma_1: 30 s/m}
        drives: {push: {body: block, mode: force, limit: 20 N}}
        """,
    )
    plant.advance(0)
    broke = 0.0
    for cycle in range(1, 8000):
        command(plant, "push", cycle * 1e-3)  # 1 N/s
        plant.advance(cycle * MS)
        if at(plant, "block")[1] > 0.01:
            broke = cycle * 1e-3
            break
    assert broke == pytest.approx(0.3 * 2 * 9.81, rel=0.02)


def test_geared_shafts_share_their_inertia(tmp_path: Path) -> None:
    plant = plant_of(
        tmp_path,
        """
        bodies:
          motor: {inertia: 1e-4 kg m^2}
          drum: {inertia: 2e-2 kg m^2}
          load: {mass: 3 kg}
        gears:
          reducer: {between: [motor, drum], ratio: 10}
          rope: {between: [drum, load], radius: 50 mm}
        drives: {motor_drive: {body: motor, mode: force, limit: 1 N m, bandwidth: 100 kHz}}
        """,
    )
    plant.advance(0)
    command(plant, "motor_drive", 0.1)
    plant.advance(500 * MS)
    reflected = 1e-4 + (2e-2 + 3 * 0.05**2) / 100
    assert at(plant, "motor")[1] == pytest.approx(0.1 * 0.5 / reflected, rel=1e-4)
    assert at(plant, "load")[1] == pytest.approx(at(plant, "motor")[1] / 10 * 0.05)


def test_back_emf_ends_the_speed_of_a_motor(tmp_path: Path) -> None:
    plant = plant_of(
        tmp_path,
        """
        bodies: {rotor: {inertia: 1e-4 kg m^2}}
        drives:
          motor: {body: rotor, mode: current, limit: 2 A, torque_constant: 50 mN m/A, supply: 24 V,
                  resistance: 2 ohm}
        """,
    )
    plant.advance(0)
    command(plant, "motor", 2.0)
    plant.advance(50 * MS)
    assert at(plant, "rotor")[1] == pytest.approx(2 * 0.05 * 0.05 / 1e-4, rel=0.01)
    plant.advance(5000 * MS)
    assert at(plant, "rotor")[1] == pytest.approx(24 / 0.05, rel=1e-3)


def test_pressed_friction_is_that_of_its_spring(tmp_path: Path) -> None:
    plant = plant_of(
        tmp_path,
        """
        bodies:
          disk: {inertia: 1 kg m^2, speed: 10 rad/s}
          pin: {mass: 0.2 kg}
          loader: {mass: 1 kg}
        springs:
          arm: {between: [pin, ground], stiffness: 20 kN/m, damping: 20 N s/m}
          press: {between: [ground, loader], stiffness: 10 kN/m, damping: 40 N s/m, preload: -5 N}
        friction:
          contact:
            between: [disk, pin]
            radius: 40 mm
            pressed_by: press
            law: {kind: coulomb, coulomb: 0.25}
        drives: {load: {body: loader, mode: force, limit: 100 N}}
        sensors:
          cell: {measures: load, of: contact, low: 0 N, high: 100 N}
          torque: {measures: torque, of: contact, low: -10 N m, high: 10 N m}
        """,
    )
    plant.advance(0)
    command(plant, "load", 35.0)
    plant.advance(1000 * MS)
    assert plant.readings[0] == pytest.approx(35.0, rel=1e-6)
    assert force_in(plant, "arm") == pytest.approx(0.25 * 35, rel=1e-5)
    assert plant.readings[1] == pytest.approx(0.25 * 35 * 0.04, rel=1e-5)


def test_friction_warms_the_part_by_its_power(tmp_path: Path) -> None:
    plant = plant_of(
        tmp_path,
        """
        bodies: {disk: {inertia: 1e4 kg m^2, speed: 20 rad/s}}
        friction:
          pad: {between: [disk, ground], radius: 50 mm, load: 40 N,
                law: {kind: coulomb, coulomb: 0.5}}
        temperatures: {pad_tip: {heated_by: [pad], share: 0.5, capacity: 2 J/K, resistance: 3 K/W}}
        sensors: {t: {measures: temperature, of: pad_tip, low: 200 K, high: 500 K}}
        """,
    )
    plant.advance(0)
    plant.advance(4000 * MS)
    power = 0.5 * 0.5 * 40 * 1.0  # W, half of it into the pad
    assert plant.readings[0] - 293.15 == pytest.approx(power * 3 * (1 - math.exp(-4 / 6)), rel=1e-3)


def test_sensor_lags_by_its_bandwidth(tmp_path: Path) -> None:
    plant = plant_of(
        tmp_path,
        """
        bodies: {a: {mass: 1 kg, speed: 1 m/s}}
        sensors:
          ruler: {measures: position, of: a, low: -1 m, high: 9 m, bandwidth: 2 Hz}
        """,
    )
    plant.advance(0)
    plant.advance(1000 * MS)
    lag = 1 / (2 * math.pi * 2)
    assert plant.readings[0] == pytest.approx(1 - lag * (1 - math.exp(-1 / lag)), rel=1e-9)


def test_buffer_throws_back_what_it_stored(tmp_path: Path) -> None:
    plant = plant_of(
        tmp_path,
        """
        bodies: {a: {mass: 1 kg, speed: 1 m/s}}
        stops: {ends: {body: a, low: -1 m, high: 0.1 m, stiffness: 10 kN/m}}
        """,
    )
    _, v = over_time(plant, ["a"], 0.5)
    assert v[0, -1] == pytest.approx(-1.0, abs=1e-3)


def test_play_moves_without_force(tmp_path: Path) -> None:
    plant = plant_of(
        tmp_path,
        """
        bodies: {a: {mass: 1 kg, speed: 0.1 m/s}}
        springs: {gap: {between: [a, ground], stiffness: 10 kN/m, play: 20 mm}}
        """,
    )
    _, v = over_time(plant, ["a"], 0.09)
    assert v[0] == pytest.approx(0.1)
    plant.advance(180 * MS)
    assert at(plant, "a")[1] == pytest.approx(-0.1, abs=1e-4)


def test_position_drive_goes_where_it_is_sent(tmp_path: Path) -> None:
    plant = plant_of(
        tmp_path,
        """
        bodies: {table: {mass: 5 kg, start: 0.2 m}}
        friction: {guide: {between: [table, ground], law: {kind: coulomb, coulomb: 2 N}}}
        drives:
          axis: {body: table, mode: position, limit: 100 N, speed_limit: 0.5 m/s, gain: 500 N s/m,
                 integral: 2000 N/m, position_gain: 20 1/s, low: 0 m, high: 1 m}
        """,
    )
    plant.advance(0)
    command(plant, "axis", 0.9)
    _, v = over_time(plant, ["table"], 3.0)
    assert at(plant, "table")[0] == pytest.approx(0.9, abs=1e-4)
    assert v.max() == pytest.approx(0.5, rel=0.05)
