"""The recursion against an ODE solver, its sensitivities against differences, its order."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from rigd.analysis.friction import SlipForce
from rigd_analyses.lugre.laws.bristle import stribeck
from rigd_analyses.lugre.model import LugreModel, friction, friction_gradient

FloatArray = NDArray[np.float64]
#: PVC: the stiffest bristle and the sharpest Stribeck effect of the three floors.
Q = np.array([0.0044, 0.12, np.log(0.15 / 0.12), 49.933, 0.372, 2.8084])


def sweep(t: FloatArray) -> FloatArray:
    """Return a slip in m/s that starts at zero, reverses, and covers 80 mm/s."""
    return 0.08 * np.sin(2.0 * np.pi * 3.0 * t) * (1.0 - np.exp(-t / 0.02))


def trial(dt: float, duration: float = 0.5) -> SlipForce:
    t = np.arange(round(duration / dt) + 1, dtype=np.float64) * dt
    slip = sweep(t)
    return SlipForce("sweep", dt, slip, np.zeros_like(t), np.ones_like(t))


def solved(t: FloatArray, q: FloatArray) -> FloatArray:
    """Return F/F_N at ``t`` from section 2 by Radau at rtol 1e-10."""
    v_s, mu_c, ratio, s0, s1, s2 = q
    mu_s = mu_c * np.exp(ratio)

    def rate(time: float, z: FloatArray) -> FloatArray:
        v = sweep(np.array([time]))[0]
        g = mu_c + (mu_s - mu_c) * np.exp(-np.sqrt(abs(v) / v_s))
        return np.array([s0 * (v - abs(v) * z[0] / g)])

    z = solve_ivp(rate, (0.0, t[-1]), [0.0], "Radau", t, rtol=1e-10, atol=1e-13, max_step=2e-3).y[0]
    v = sweep(t)
    g = mu_c + (mu_s - mu_c) * np.exp(-np.sqrt(np.abs(v) / v_s))
    return np.asarray(z + s1 * (v - np.abs(v) * z / g) + s2 * v)


def test_kernel_matches_ode_solver_with_second_order() -> None:
    errors = []
    for dt in (4e-3, 2e-3, 1e-3):
        samples = trial(dt)
        t = np.arange(len(samples.slip_m_s), dtype=np.float64) * dt
        difference: FloatArray = LugreModel([samples]).predict(Q) - solved(t, Q)
        errors.append(float(np.max(np.abs(difference))))
    assert errors[2] < 2e-4  # of F_N, where F itself reaches 0.35
    order = np.log2(errors[0] / errors[2]) / 2.0
    assert 1.5 < order < 2.6  # the square root in g costs a little at each reversal


def test_recursion_is_exact_for_constant_slip() -> None:
    v = 0.03
    for dt in (1e-3, 0.1):
        slip = np.full(11, v)
        model = LugreModel([SlipForce("c", dt, slip, np.zeros(11), np.ones(11))])
        g = float(friction(Q, np.array([v]))[0])
        z = g * (1.0 - np.exp(-Q[3] * v * dt * np.arange(11) / g))
        exact = z + Q[4] * (v - v * z / g) + Q[5] * v
        np.testing.assert_allclose(model.predict(Q), exact, rtol=1e-13)


def test_sensitivities_agree_with_differences() -> None:
    model = LugreModel([trial(1e-3), trial(1e-3, 0.3)])
    jacobian = model.jacobian(Q)
    for index in range(6):
        h = 2e-3 * max(Q[index], 1e-3)
        # Eighth order central differences: truncation below rounding at this step.
        weights = {1: 4.0 / 5.0, 2: -1.0 / 5.0, 3: 4.0 / 105.0, 4: -1.0 / 280.0}
        column = np.zeros(len(jacobian))
        for k, weight in weights.items():
            up, down = Q.copy(), Q.copy()
            up[index] += k * h
            down[index] -= k * h
            column += weight * (model.predict(up) - model.predict(down)) / h
        scale = float(np.max(np.abs(column)))
        assert float(np.max(np.abs(jacobian[:, index] - column))) <= 5e-8 * scale, index


def test_fused_normal_equations_are_the_dense_ones() -> None:
    base = trial(1e-3)
    rng = np.random.default_rng(1)
    measured = rng.standard_normal(len(base.force))
    mask = (rng.random(len(base.force)) > 0.3).astype(np.float64)
    model = LugreModel([SlipForce("a", 1e-3, base.slip_m_s, measured, mask)] * 2)
    weights = rng.random(2 * len(mask))
    fused = model.normal_equations(Q, weights)
    j, r, w = model.jacobian(Q), model.residuals(Q), model.mask * weights
    assert fused.cost == pytest.approx(0.5 * float(w @ r**2), rel=1e-12)
    assert fused.cost == pytest.approx(model.cost(Q, weights), rel=1e-14)
    np.testing.assert_allclose(fused.gradient, j.T @ (w * r), rtol=1e-11)
    np.testing.assert_allclose(fused.information, (j * w[:, None]).T @ j, rtol=1e-11)


def test_a_trial_starts_with_the_bristle_at_rest() -> None:
    found, two = trial(1e-3), trial(1e-3)
    both = LugreModel([found, two]).predict(Q)
    alone = LugreModel([two]).predict(Q)
    np.testing.assert_array_equal(both[len(found.force) :], alone)


def test_the_curve_is_the_corrected_equation_6() -> None:
    v = np.array([0.0, 0.0044, 10.0])
    expected = [0.15, 0.12 + 0.03 / np.e, 0.12]
    np.testing.assert_allclose(friction(Q, v), expected, rtol=1e-9)
    assert stribeck(0.0044, Q[0], Q[1], float(np.expm1(Q[2])))[0] == pytest.approx(expected[1])
    gradient = friction_gradient(Q, v)
    for index in range(3):
        step = np.zeros(6)
        step[index] = 1e-6 * Q[index]
        difference = (friction(Q + step, v) - friction(Q - step, v)) / (2e-6 * Q[index])
        np.testing.assert_allclose(gradient[:, index], difference, rtol=1e-6, atol=1e-8)
