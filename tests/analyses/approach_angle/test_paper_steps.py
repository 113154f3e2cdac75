"""Each step of the paper's method by itself, against what it claims."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.signal import butter

from rigd_analyses.approach_angle.paper import PaperSettings
from rigd_analyses.approach_angle.paper.fourier import fit_fourier, fourier_basis
from rigd_analyses.approach_angle.paper.gauss import fit_peak
from rigd_analyses.approach_angle.paper.slip import mean_slip
from rigd_analyses.approach_angle.paper.smoothing import butterworth, central_difference, smooth
from rigd_analyses.approach_angle.paper.strain import torque_nm
from rigd_analyses.approach_angle.raw.run_data import FloatArray, Regime
from rigd_analyses.approach_angle.regime import SLIDING_SLIP, regime_of

RATE_HZ = 9600.0


def times(duration_s: float) -> FloatArray:
    return np.arange(round(duration_s * RATE_HZ)) / RATE_HZ


def test_series_in_basis_is_recovered_on_whole_second() -> None:
    t = times(1.0)
    signal = 0.4 + 0.3 * np.cos(2 * np.pi * 7 * t) - 0.2 * np.sin(2 * np.pi * 19 * t)
    fit = fit_fourier(t, signal[:, None], highest_hz=19, rcond=1e-12)
    expected = np.zeros(39)
    expected[[0, 7, 19 + 19]] = 0.4, 0.3, -0.2
    np.testing.assert_allclose(fit.coefficients[:, 0], expected, atol=1e-12)


def test_printed_system_with_b0_has_one_redundant_column() -> None:
    t = times(1.0)
    signal = np.random.default_rng(1).standard_normal(t.size)
    ours = fit_fourier(t, signal[:, None], highest_hz=19, rcond=1e-12)
    printed = np.insert(ours.basis, 20, 0.0, axis=1)
    solution, _, rank, _ = np.linalg.lstsq(printed, signal, rcond=1e-12)
    assert rank == 39 == fourier_basis(t, 19).shape[1]
    np.testing.assert_allclose(printed @ solution, ours.curves[:, 0], atol=1e-12)


def test_constant_of_short_record_is_not_its_mean(
    golden: Callable[[str], Any],
) -> None:
    run = golden("r5").run
    fit = fit_fourier(run.t_s, run.gauge_a_v[:, None], highest_hz=19, rcond=1e-12)
    assert abs(fit.coefficients[0, 0]) > 1e3
    steady = run.t_s > 0.1
    assert np.mean(fit.curves[steady, 0]) == pytest.approx(
        np.mean(run.gauge_a_v[steady]), rel=0.004
    )


def test_mean_of_curve_hardly_depends_on_rcond(golden: Callable[[str], Any]) -> None:
    """The bandwidth does, and with it the edges: rcond is a setting that must be reported."""
    run = golden("r3").run
    found, other = (
        fit_fourier(run.t_s, run.gauge_a_v[:, None], highest_hz=19, rcond=rcond).curves[:, 0]
        for rcond in (1e-12, 1e-4)
    )
    steady = run.t_s > 0.1
    assert np.mean(other[steady]) == pytest.approx(np.mean(found[steady]), rel=0.014)
    assert np.max(np.abs(other - found)) > 0.01


def corrected(eps_x: float, eps_y: float, gamma: float, theta: float) -> tuple[float, float]:
    cos, sin = np.cos(theta), np.sin(theta)
    return (
        eps_x * cos**2 + eps_y * sin**2 + gamma * cos * sin,
        eps_x * sin**2 + eps_y * cos**2 - gamma * cos * sin,
    )


def test_gauges_at_45_degrees_show_torque_without_bending() -> None:
    """Al 6082, G = 26 GPa, r = 10 mm: 146.9 microstrain at the 6 N m of the paper."""
    shear_modulus, radius = 26e9, 0.010
    scale = shear_modulus * np.pi * radius**4 / 2.0 / radius
    gamma = 6.0 / scale
    assert gamma == pytest.approx(146.9e-6, rel=1e-3)
    for bending in (0.0, 50e-6):
        a, b = corrected(bending, -0.33 * bending, gamma, np.pi / 4.0)
        assert torque_nm(np.array([a]), np.array([b]), scale)[0] == pytest.approx(6.0)


def test_torque_of_curves_is_curve_of_torques_series(
    golden: Callable[[str], Any],
) -> None:
    run = golden("r2").run
    gauges = np.stack([run.gauge_a_v, run.gauge_b_v], axis=1)
    fit = fit_fourier(run.t_s, gauges, highest_hz=19, rcond=1e-12)
    of_series = fit.basis @ torque_nm(fit.coefficients[:, 0], fit.coefficients[:, 1], 2.03)
    of_curves = torque_nm(fit.curves[:, 0], fit.curves[:, 1], 2.03)
    np.testing.assert_allclose(of_series, of_curves, atol=1e-6)


@pytest.mark.parametrize("sigma", [0.005, 0.02, 0.06])
@pytest.mark.parametrize("peak_s", [0.02, 0.2])
def test_gaussian_sigma_is_found_in_a_clipped_window(sigma: float, peak_s: float) -> None:
    t = times(0.5)
    at = t[np.searchsorted(t, peak_s)]
    found = fit_peak(t, 2.5 * np.exp(-0.5 * ((t - at) / sigma) ** 2), 0.1)
    assert (found.height_nm, found.time_s) == (2.5, at)
    assert found.sigma_s == pytest.approx(sigma, rel=1e-6)
    assert t[found.window][0] >= max(at - 0.05, 0.0)
    assert t[found.window][-1] == pytest.approx(at + 0.05, abs=1.5 / RATE_HZ)


def test_flat_torque_has_no_end_of_its_peak() -> None:
    t = times(0.5)
    assert fit_peak(t, np.ones(t.size), 0.1).sigma_s > 1.0


@pytest.mark.parametrize("cutoff_hz", [20.0, 200.0])
def test_the_low_pass_is_butterworths(cutoff_hz: float) -> None:
    for ours, theirs in zip(
        butterworth(cutoff_hz, RATE_HZ), butter(1, cutoff_hz, fs=RATE_HZ), strict=True
    ):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12)


def test_smoothing_keeps_a_line_and_shortens_both_ends() -> None:
    settings, t = PaperSettings(), times(0.4)
    signals = np.stack([0.3 + 2.0 * t, 7.0 - t])
    half = settings.lost // 2
    np.testing.assert_allclose(
        smooth(signals, RATE_HZ, settings), signals[:, half : t.size - half], atol=1e-12
    )
    assert settings.lost == 154


def test_smoothing_without_phase_cuts_at_9_6_hz() -> None:
    settings, t = PaperSettings(), times(3.0)
    half = settings.lost // 2
    inside = slice(t.size // 3, 2 * t.size // 3)
    wave = np.sin(2.0 * np.pi * 9.6 * t)
    smoothed = smooth(wave[None, :], RATE_HZ, settings)[0]
    shifted = wave[half : t.size - half]
    gain = smoothed[inside] @ shifted[inside] / (shifted[inside] @ shifted[inside])
    assert gain == pytest.approx(np.sqrt(0.5), abs=0.01)
    np.testing.assert_allclose(smoothed[inside], gain * shifted[inside], atol=0.01)


def test_central_difference_is_exact_for_a_parabola() -> None:
    t = times(0.1)
    np.testing.assert_allclose(
        central_difference(t, np.stack([t**2, 3.0 * t])),
        np.stack([2.0 * t[1:-1], np.full(t.size - 2, 3.0)]),
        atol=1e-11,
    )


@pytest.mark.parametrize(("degrees", "paper"), [(0, 0.0), (15, -0.034), (30, -0.134), (45, -0.293)])
def test_rolling_wheel_lacks_corrected_slip_at_any_angle(degrees: int, paper: float) -> None:
    alpha = np.radians(degrees)
    platform = np.linspace(1e-6, 2.0, 500)
    slip = mean_slip(platform * np.cos(alpha), platform, float(alpha))
    assert slip.corrected == pytest.approx(0.0, abs=1e-12)
    assert slip.paper == pytest.approx(paper, abs=5e-4)


@pytest.mark.parametrize(
    ("share", "regime"),
    [(0.0, Regime.ROLLING), (0.05, Regime.ROLLING), (0.5, Regime.MIXED), (0.95, Regime.SLIDING)],
)
def test_regime_by_the_share_of_samples_that_slide(share: float, regime: Regime) -> None:
    slip = np.full(100, 0.5 * SLIDING_SLIP)
    slip[: round(100 * share)] = 2.0
    assert regime_of(slip) is regime
