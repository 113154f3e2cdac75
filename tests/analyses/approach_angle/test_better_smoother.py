"""The smoother's claims: its gain over frequency, no phase, honest uncertainty, free ends."""

from __future__ import annotations

import numpy as np
import pytest

from rigd_analyses.approach_angle.better.smoother import smooth

PERIOD_S = 1.0 / 960.0
T_S = PERIOD_S * np.arange(600)


@pytest.mark.parametrize("hz", [2.0, 7.0, 14.0, 20.0])
def test_amplitude_falls_with_sixth_power_without_phase_shift(hz: float) -> None:
    wave = np.sin(2 * np.pi * hz * T_S)
    middle = slice(200, 400)
    found = smooth(wave, PERIOD_S, 14.0).position[middle]
    gain = 1.0 / (1.0 + (hz / 14.0) ** 6)
    assert found == pytest.approx(gain * wave[middle], abs=0.01)


def test_constant_acceleration_passes_unchanged_up_to_the_ends() -> None:
    track = smooth(0.3 + 0.1 * T_S + 2.5 * T_S**2, PERIOD_S, 16.0)
    assert track.position == pytest.approx(0.3 + 0.1 * T_S + 2.5 * T_S**2, abs=1e-6)
    assert track.speed == pytest.approx(0.1 + 5.0 * T_S, abs=1e-3)
    assert track.acceleration[50:-50] == pytest.approx(5.0, abs=1e-3)


def test_speed_uncertainty_is_true_error_for_random_motion() -> None:
    """Motion with random jerk, of the size that belongs to the cut-off, seen in white noise."""
    rng, noise, cutoff_hz, fine = np.random.default_rng(1), 1e-3, 14.0, 10
    density = noise**2 * PERIOD_S * (2 * np.pi * cutoff_hz) ** 6
    step = PERIOD_S / fine
    errors, claims = [], []
    for _ in range(150):
        jerk = np.sqrt(density / step) * rng.standard_normal(fine * T_S.size)
        acceleration = step * np.cumsum(jerk)
        speed = step * np.cumsum(acceleration)
        position = step * np.cumsum(speed)
        seen = position[::fine] + noise * rng.standard_normal(T_S.size)
        track = smooth(seen, PERIOD_S, cutoff_hz)
        errors.append((track.speed - speed[::fine])[[0, 300, 599]])
        claims.append(track.speed_u[[0, 300, 599]])
    assert np.std(errors, axis=0) == pytest.approx(np.mean(claims, axis=0), rel=0.25)


def test_smoothed_speed_is_less_certain_at_ends() -> None:
    u = smooth(np.random.default_rng(2).standard_normal(T_S.size), PERIOD_S, 14.0).speed_u
    assert u[0] > 3 * u[300] and u[-1] > 3 * u[300]


def test_a_signal_without_any_noise_is_smoothed_too() -> None:
    assert np.all(np.isfinite(smooth(np.full(50, 2.0), PERIOD_S, 14.0).speed))


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(ValueError, match="3 samples"):
        smooth(np.zeros(3), PERIOD_S, 14.0)
