"""The shipped friction laws: each keeps the rules, and follows the equations of its paper."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from rigd.analysis.friction import FrictionLaw, LawModel, SlipForce
from rigd.analysis.friction.check import check_friction_law
from rigd.analysis.friction.registry import find_law, installed_laws

FloatArray = NDArray[np.float64]

#: Name and number of parameters of each law that comes with rigd.
SHIPPED = {
    "coulomb-viscous": 2,
    "stribeck": 4,
    "magic-formula": 4,
    "dahl": 2,
    "dahl-viscous": 3,
    "lugre-4": 4,
    "lugre": 6,
    "lugre-rolling": 7,
    "maxwell-slip": 7,
}
PERIOD_S = 1e-3
ROLLING_M_S = 0.4


def slip_at(t: float) -> float:
    """Return a slip in m/s that begins at zero, reverses, and covers 80 mm/s."""
    return float(0.08 * np.sin(2.0 * np.pi * 1.5 * t) * (1.0 - np.exp(-t / 0.02)))


def force_of(name: str, theta: list[float]) -> tuple[FloatArray, FloatArray]:
    """Return times in s and F/F_N of the law for :func:`slip_at`, rolling at 0.4 m/s."""
    t: FloatArray = np.arange(1001, dtype=np.float64) * PERIOD_S
    slip = np.array([slip_at(x) for x in t])
    rolling = np.full(len(t), ROLLING_M_S)
    trial = SlipForce("", PERIOD_S, slip, np.zeros(len(t)), np.ones(len(t)), rolling)
    return t, LawModel(find_law(name), [trial]).predict(np.array(theta))


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_law_keeps_the_rules(name: str) -> None:
    law = find_law(name)
    check_friction_law(law)
    assert len(law.parameters) == SHIPPED[name]
    assert law.title()


def test_all_laws_of_rigd_are_installed() -> None:
    laws, broken = installed_laws()
    assert laws.keys() >= SHIPPED.keys()
    assert broken == ()


def test_dahl_with_viscous_friction_matches_ode_solver() -> None:
    mu, stiffness, viscous = 0.12, 40.0, 2.5

    def rate(t: float, z: FloatArray) -> FloatArray:
        v = slip_at(t)
        return stiffness * (v - abs(v) * z / mu)

    t, force = force_of("dahl-viscous", [mu, stiffness, viscous])
    z = solve_ivp(rate, (0.0, t[-1]), [0.0], "Radau", t, rtol=1e-9, atol=1e-12, max_step=2e-3).y[0]
    exact = z + viscous * np.array([slip_at(x) for x in t])
    assert np.max(np.abs(force - exact)) < 5e-5  # where F reaches 0.3


def test_rolling_wheel_matches_ode_solver() -> None:
    v_s, mu_c, ratio, s0, s1, s2, kappa = 0.02, 0.1, 0.4, 50.0, 0.4, 2.5, 8.0

    def deflection_rate(v: float, p: float) -> float:
        g = mu_c * (1.0 + np.expm1(ratio) * np.exp(-np.sqrt(abs(v) / v_s)))
        return float(v - s0 * abs(v) * p / g - kappa * ROLLING_M_S * p)

    def rate(t: float, p: FloatArray) -> list[float]:
        return [deflection_rate(slip_at(t), p[0])]

    t, force = force_of("lugre-rolling", [v_s, mu_c, ratio, s0, s1, s2, kappa])
    p = solve_ivp(rate, (0.0, t[-1]), [0.0], "Radau", t, rtol=1e-9, atol=1e-12, max_step=2e-3).y[0]
    exact = [
        s0 * q + s1 * deflection_rate(slip_at(x), q) + s2 * slip_at(x)
        for x, q in zip(t, p, strict=True)
    ]
    assert np.max(np.abs(force - exact)) < 2e-4
    assert np.max(np.abs(force_of("lugre", [v_s, mu_c, ratio, s0, s1, s2])[1] - exact)) > 1e-2


def test_rolling_law_without_relaxation_equals_lugre() -> None:
    theta = [0.02, 0.1, 0.4, 50.0, 0.4, 2.5]
    _, plain = force_of("lugre", theta)
    _, rolling = force_of("lugre-rolling", [*theta, 0.0])
    np.testing.assert_allclose(rolling, plain, rtol=0.0, atol=1e-14)


def test_lugre_with_4_parameters_is_6_without_stribeck() -> None:
    _, six = force_of("lugre", [0.02, 0.1, 0.0, 50.0, 0.4, 2.5])
    _, four = force_of("lugre-4", [0.1, 50.0, 0.4, 2.5])
    np.testing.assert_allclose(four, six, rtol=0.0, atol=1e-14)


def slipped(n: int, stiffness: list[float], s: float) -> FloatArray:
    """Return the force of ``n`` samples of Maxwell-slip elements, each a spring that slips."""
    t = np.arange(n) * PERIOD_S
    slip = np.array([slip_at(x) for x in t])
    share, forces, out = s / len(stiffness), [0.0] * len(stiffness), []
    for k in range(n):
        moved = 0.0 if k == 0 else 0.5 * (slip[k] + slip[k - 1]) * PERIOD_S
        forces = [
            min(max(f + stiff * moved, -share), share)
            for f, stiff in zip(forces, stiffness, strict=True)
        ]
        out.append(sum(forces))
    return np.array(out)


def test_maxwell_slip_without_stribeck_is_springs_that_slip() -> None:
    """With s(V) constant an element holds what it slipped at: the model of Iwan."""
    spread, total = 3.0, 60.0
    first = total / (1.0 + spread + spread**2 + spread**3)
    _, force = force_of("maxwell-slip", [0.02, 0.1, 0.0, total, spread, 50.0, 1e-3])
    t = np.arange(len(force)) * PERIOD_S
    viscous = 1e-3 * np.array([slip_at(x) for x in t])
    springs = slipped(len(force), [first * spread**i for i in range(4)], 0.1)
    np.testing.assert_allclose(force, springs + viscous, rtol=0.0, atol=1e-12)


def test_maxwell_slip_follows_its_curve_with_a_lag() -> None:
    """At a falling friction the force stays above the curve by what the attraction leaves."""
    t: FloatArray = np.arange(3000, dtype=np.float64) * PERIOD_S
    slip = np.minimum(0.05 * t, 0.1)  # grows for 2 s, then stays
    trial = SlipForce("", PERIOD_S, slip, np.zeros(len(t)), np.ones(len(t)))
    law: type[FrictionLaw] = find_law("maxwell-slip")
    theta = np.array([0.02, 0.1, 1.0, 1e3, 1.5, 1.0, 1e-3])
    force = LawModel(law, [trial]).predict(theta)
    above = force - law.steady(theta, slip, 0.0)
    assert above[1900] > 1e-3  # of F_N, while the slip grows
    assert 0.0 < above[-1] < 1e-3 * above[1900]


def test_magic_formula_has_its_peak_slope_and_sign() -> None:
    law = find_law("magic-formula")
    peak, shape, stiffness, curvature = 0.3, 1.6, 40.0, -0.5
    theta = np.array([peak, shape, stiffness, curvature])
    slip = np.linspace(0.0, 2.0, 20_001)
    force = law.steady(theta, slip, 0.0)
    assert np.max(force) == pytest.approx(peak, rel=1e-6)
    assert force[1] / slip[1] == pytest.approx(stiffness * shape * peak, rel=1e-3)
    np.testing.assert_array_equal(law.steady(theta, -slip, 0.0), -force)
