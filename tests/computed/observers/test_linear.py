"""Matrices of a linear filter: discretised exactly, and refused if they make no filter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from rigd.computed.observers.linear import discretised, is_covariance, unequal_place, unseen


@pytest.mark.parametrize("rate", [0.0, 1.0, 300.0, 5e4])
def test_discretised_equals_integrals(rate: float) -> None:
    a = np.array([[0.0, 1.0, 0.0], [-4.0, -0.5, 1.0], [0.0, 0.0, -rate]])
    b = np.array([[0.0], [2.0], [rate]])
    q = np.array([[1e-3, 0.0, 0.0], [0.0, 2.0, 0.5], [0.0, 0.5, 7.0]])
    period = 1e-3
    f, g, noise = discretised(a, b, q, period)
    assert np.allclose(f, expm(a * period), rtol=1e-12, atol=1e-15)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    parts = np.concatenate([(nodes + 1) / 80 + part / 40 for part in range(40)]) * period
    shares = np.tile(weights, 40) / 80 * period  # 40 parts of 8 points: exact to 1e-12
    waves = [expm(a * part) for part in parts]
    wanted = sum(share * wave @ b for share, wave in zip(shares, waves, strict=True))
    assert np.allclose(g, wanted, rtol=1e-9, atol=1e-14)
    spread = sum(share * wave @ q @ wave.T for share, wave in zip(shares, waves, strict=True))
    assert np.allclose(noise, spread, rtol=1e-8, atol=1e-14)
    assert np.array_equal(noise, noise.T)


def test_covariance_is_judged_in_any_units() -> None:
    scale = np.diag([1e-9, 1e6])
    good = scale @ np.array([[1.0, 0.999], [0.999, 1.0]]) @ scale
    wrong = scale @ np.array([[1.0, 1.001], [1.001, 1.0]]) @ scale
    assert is_covariance(good, definite=True)
    assert not is_covariance(wrong)
    assert is_covariance(np.zeros((2, 2)))
    assert not is_covariance(np.zeros((2, 2)), definite=True)
    assert not is_covariance(np.array([[0.0, 1.0], [1.0, 1.0]]))
    assert unequal_place(good) is None
    assert unequal_place(np.array([[1.0, 2.0], [3.0, 1.0]])) == (0, 1)


@pytest.mark.parametrize("period", [2e-4, 1e-2])
@pytest.mark.parametrize(
    ("a", "h", "names"),
    [
        ([[0, 1, 0], [0, 0, 1], [0, 0, 0]], [[1, 0, 0]], []),  # three integrators in a row
        ([[0, 1, 0], [0, 0, 1], [0, 0, 0]], [[0, 1, 0]], ["x"]),
        ([[0, 1, 0], [0, 0, 1], [0, 0, -2]], [[0, 1, 0]], ["x"]),
        ([[-1, 1, 0], [0, 0, 1], [0, 0, 0]], [[0, 1, 0]], []),  # x is not seen, but dies out
        ([[0, 0, 0], [0, 0, 0], [0, 0, -1]], [[1, 1, 0]], ["x", "y"]),  # only their sum is seen
        ([[0, 1e-6, 0], [-1e6, 0, 0], [0, 0, -1]], [[1e-3, 0, 0]], []),
    ],
)
def test_unseen_states_are_named(
    a: list[list[float]], h: list[list[float]], names: list[str], period: float
) -> None:
    f, _, _ = discretised(np.array(a, float), np.zeros((3, 0)), np.zeros((3, 3)), period)
    assert unseen(f, np.array(h, float), period, ["x", "y", "z"]) == names
