"""The noise of the current monitor, which decides how far the simulated motion may drift."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rigd_analyses.lugre.rig.current import monitor_noise_a

COUNT_A = 3.05e-3  #: 14 bit over 20 V at 0.4 V/A


@pytest.mark.parametrize("counts", [0.7, 1.0, 1.7, 2.0, 2.6, 4.0])
def test_noise_of_a_rounded_current_is_right(counts: float) -> None:
    random = np.random.default_rng(round(10 * counts))
    current = 0.6 + counts * COUNT_A * random.standard_normal(4000)
    current[1000:] += 0.3  # a jump
    current[2000] += 0.2  # and a spike
    found = monitor_noise_a(COUNT_A * np.round(current / COUNT_A))
    assert found == pytest.approx(COUNT_A * math.hypot(counts, math.sqrt(1 / 12)), rel=0.05)


def test_constant_current_has_no_noise() -> None:
    assert monitor_noise_a(np.append(np.zeros(100), np.full(100, 0.5))) == 0.0
    assert monitor_noise_a(np.zeros(2)) == 0.0
