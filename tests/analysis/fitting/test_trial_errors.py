"""Errors that last for whole trials, or parts of them: found, sized, and no false alarm."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from rigd.analysis.fitting.trial_errors import Lasting, lasting

TRIALS, SAMPLES, BLOCK = 7, 300, 10


def noise(seed: int, phi: float = 0.5) -> np.ndarray:
    """Return residuals of all trials that go together for a few samples only, (trials, n)."""
    white = np.random.default_rng(seed).standard_normal((TRIALS, SAMPLES + 100))
    return lfilter([1.0], [1.0, -phi], white, axis=1)[:, 100:]


def found_in(residuals: np.ndarray, parameters: int = 4) -> Lasting | None:
    slices = [slice(k * SAMPLES, (k + 1) * SAMPLES) for k in range(len(residuals))]
    flat = residuals.ravel()
    return lasting(flat, np.ones(len(flat)), slices, parameters, BLOCK)


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.7])
def test_noise_alone_is_no_lasting_error(phi: float) -> None:
    alarms = sum(found_in(noise(seed, phi), 0) is not None for seed in range(400))
    assert alarms <= 7  # 2 expected at most, and three and a half standard deviations


@pytest.mark.parametrize(("unit", "size"), [("N", "0.03 N"), ("1", "0.03")])
def test_lasting_error_has_its_unit(unit: str, size: str) -> None:
    gate = Lasting(2.0, 2.0, 0.01, 3.0, 1).gate(unit, 3.0)
    assert f"trials lie {size} off it" in gate.sentence


def test_offset_of_each_trial_lasts_a_trial() -> None:
    offsets = np.random.default_rng(1).standard_normal((TRIALS, 1))
    found = found_in(noise(2) + offsets)
    assert found is not None
    assert found.parts == 1
    assert found.rms == pytest.approx(np.sqrt(np.mean(offsets**2)), rel=0.1)
    # As if each trial were a single sample, of a t distribution with 3 degrees of freedom.
    assert found.spread > SAMPLES


def test_curve_within_one_trial_lasts_a_part() -> None:
    bent = np.cos(np.linspace(0.0, 2.0 * np.pi, SAMPLES))
    found = found_in((noise(3) + bent)[:1])
    assert found is not None
    assert found.parts > 1


def test_trials_without_noise_show_no_error() -> None:
    assert found_in(np.zeros((TRIALS, SAMPLES))) is None
