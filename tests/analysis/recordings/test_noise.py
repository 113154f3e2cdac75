"""The noise of sensors whose readings are rounded, beside a motion, jumps and spikes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rigd.analysis.recordings.noise import white_noise

STEP = 3.05e-3  #: 14 bit over 20 V at 0.4 V/A


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("steps", [0.7, 1.0, 1.7, 2.0, 2.6, 4.0])
def test_noise_of_rounded_readings_is_right(steps: float, order: int) -> None:
    random = np.random.default_rng(round(10 * steps))
    shown = 0.6 + steps * STEP * random.standard_normal(4000)
    shown += 0.5 * np.sin(np.linspace(0.0, 9.0, 4000))  # a motion
    shown[1000:] += 0.3  # a jump
    shown[2000] += 0.2  # and a spike
    found = white_noise(STEP * np.round(shown / STEP), order)
    assert found == pytest.approx(STEP * math.hypot(steps, math.sqrt(1 / 12)), rel=0.05)


def test_constant_readings_have_no_noise() -> None:
    assert white_noise(np.append(np.zeros(100), np.full(100, 0.5)), jump=0.03) == 0.0
    assert white_noise(np.zeros(2)) == 0.0
