"""Claims of single pieces of the physics: derivatives, closed forms, energy, noise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rigd.sdk.noise import normal_pair
from rigd_sim.lugre import kernel, records
from rigd_sim.lugre.parameters import LugreParameters

FLOORS = ["stone", "pvc", "paperboard"]


def row(parameters: LugreParameters, floor: str = "stone") -> Any:
    rows = records.constants(
        parameters, getattr(parameters.floors, floor), 3.9593, noise=True, vibration=True
    )
    return rows.view(np.recarray)[0]


@pytest.mark.parametrize("floor", FLOORS)
def test_jacobian_agrees_with_differences(parameters: LugreParameters, floor: str) -> None:
    c, state = row(parameters, floor), records.state_at_rest().view(np.recarray)[0]
    random = np.random.default_rng(11)

    def rates(v: float, w: float) -> tuple[float, ...]:
        g, bend = kernel.stribeck(c, c.r * w - v)
        return kernel.speed_rates(c, state, v, w, g, bend, 0.8, 0.5, True)

    worst = 0.0
    for _ in range(200):
        v = float(random.uniform(-2, 2))
        slip = float(random.choice([-1, 1]) * 10 ** random.uniform(-3, -0.5))
        w = (v + slip) / c.r
        state.p, state.theta = random.uniform(-0.01, 0.01), random.uniform(0, 6)
        state.i = random.uniform(-1.5, 1.5)
        analytic = np.array(rates(v, w)[2:]).reshape(2, 2)
        dv = min(1e-6, abs(slip) / 100)
        dw = dv / c.r
        columns = [
            (np.array(rates(v + dv, w)[:2]) - np.array(rates(v - dv, w)[:2])) / (2 * dv),
            (np.array(rates(v, w + dw)[:2]) - np.array(rates(v, w - dw)[:2])) / (2 * dw),
        ]
        error = np.abs(np.array(columns).T - analytic) / np.abs(analytic).max(axis=1)[:, None]
        worst = max(worst, float(error.max()))
    assert worst <= 1e-5


@pytest.mark.parametrize("coupling", [0.0, 1.0])
def test_lateral_force_solves_its_loop(parameters: LugreParameters, coupling: float) -> None:
    """Put back into Eqs. 22, 25, 26 the closed form leaves nothing, and its slope is its slope."""
    c = row(parameters)
    c.coupling = coupling
    lifted = set()
    for speed in np.linspace(-0.8, 0.8, 401):
        force, slope = kernel.lateral_force(c, speed)
        first = (-c.weight * c.mass_offset - force * c.height) / c.row_distance
        second = c.weight - first
        s = c.roller_dry * np.tanh(speed / c.smooth) + c.roller_viscous * speed
        if coupling == 0.0:
            assert force - s * (abs(first) + abs(second)) == pytest.approx(0.0, abs=1e-9)
            lifted.add(first < 0)
        else:
            assert force == pytest.approx(s * c.weight, abs=1e-12)
        ahead, behind = (kernel.lateral_force(c, speed + d)[0] for d in (1e-7, -1e-7))
        if abs(first) > 0.01:  # away from the kink
            assert slope == pytest.approx((ahead - behind) / 2e-7, rel=1e-5, abs=1e-4)
    if coupling == 0.0:
        assert lifted == {True, False}, "the sweep must lift a row, and not always"


def test_lateral_force_acts_differently_by_sign(parameters: LugreParameters) -> None:
    """G > 0 relieves the guide, G < 0 loads it: 0.304 N falls for one sign, rises for the other."""
    c = row(parameters)

    def guide_friction(speed: float) -> float:
        force, _ = kernel.lateral_force(c, speed)
        return kernel.resistances(c, 1.0, kernel.loads(c, force)[0])[0]

    assert guide_friction(0.0) == pytest.approx(0.304, abs=1e-6)
    assert guide_friction(0.35) < 0.15
    assert guide_friction(-0.35) > 0.55


def test_bristles_settle_at_the_stribeck_curve(parameters: LugreParameters) -> None:
    """In steady slip sigma_0 p = g: F/F_N = g + sigma_2 V_r (Eq. 4)."""
    c = row(parameters, "pvc")
    g, bend = kernel.stribeck(c, 0.02)
    p = kernel.bristles(c, 0.0, 0.02, g, 10.0)
    force, _ = kernel.traction(c, p, 0.02, g, bend)
    assert force / c.weight == pytest.approx(g + c.sigma_2 * 0.02, rel=1e-12)
    assert g == pytest.approx(0.12 + 0.03 * np.exp(-np.sqrt(0.02 / 0.0044)), rel=1e-12)


def test_energy_is_conserved(parameters: LugreParameters) -> None:
    """What the shaft delivers is kinetic energy, or dissipated in contact and guide."""
    rows = records.constants(
        parameters, parameters.floors.stone, 3.9593, noise=False, vibration=False
    )
    c, state = rows.view(np.recarray)[0], records.state_at_rest()
    s = state.view(np.recarray)[0]
    commands = np.zeros(1, records.COMMANDS)
    commands["wheel_current"], commands["wheel_enabled"] = 1.2, 1.0
    step, powers = 125e-6, []
    for _ in range(4001):
        slip = c.r * s.w - s.v
        force, _ = kernel.traction(c, s.p, slip, *kernel.stribeck(c, slip))
        guide, rolling, _ = kernel.resistances(c, s.v, kernel.loads(c, 0.0)[0])
        torque, _ = kernel.shaft(c, s.w, s.i, kernel.loads(c, 0.0)[1])
        powers.append((torque * s.w, force * slip, (guide + rolling) * s.v))
        kinetic = 0.5 * c.mass * s.v**2 + 0.5 * c.inertia * s.w**2
        kernel.integrate(rows, state, commands, step, 1)
    delivered, contact, drag = np.trapezoid(np.array(powers), dx=step, axis=0)
    assert kinetic > 1.0
    assert min(contact, drag) > 0.0
    assert delivered == pytest.approx(kinetic + contact + drag, rel=1e-6)


@pytest.mark.parametrize("floor", FLOORS)
def test_operating_point_is_the_paper_s(parameters: LugreParameters, floor: str) -> None:
    """Section 3.1: v_max at 0.7 s with 1.35 A, then about 0.2 A; more on PVC."""
    rows = records.constants(
        parameters, getattr(parameters.floors, floor), 3.9593, noise=False, vibration=False
    )
    rows["x_high"] = 1e3  # an endless guide
    state, commands = records.state_at_rest(), np.zeros(1, records.COMMANDS)
    commands["wheel_current"], commands["wheel_enabled"] = 1.35, 1.0
    speeds = []
    for _ in range(4000):
        kernel.integrate(rows, state, commands, 125e-6, 8)
        speeds.append(float(state["v"][0]))
    current = float(state["i"][0])
    if floor == "pvc":
        assert current >= 0.23
    else:
        assert current == pytest.approx(0.20, abs=0.02)
    if floor == "stone":
        reached = int(np.argmax(np.array(speeds) >= 0.93 * speeds[-1])) * 1e-3
        assert reached == pytest.approx(0.70, abs=0.06)


def test_noise_is_standard_normal_and_white() -> None:
    pairs = np.array([normal_pair(7, n * 1_000_000) for n in range(40_000)])
    values = pairs.ravel()
    assert np.mean(values) == pytest.approx(0.0, abs=4 / np.sqrt(values.size))
    assert np.std(values) == pytest.approx(1.0, abs=4 / np.sqrt(2 * values.size))
    assert np.mean(values**4) == pytest.approx(3.0, abs=0.2)
    for series in (pairs[:, 0], pairs[:, 1], values):
        lagged = np.corrcoef(series[:-1], series[1:])[0, 1]
        assert lagged == pytest.approx(0.0, abs=4 / np.sqrt(series.size))
    assert normal_pair(7, 5) != normal_pair(8, 5)
