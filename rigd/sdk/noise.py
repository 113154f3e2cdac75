"""Generates the noise of plant sensors, as a function of seed and time alone."""

from __future__ import annotations

import math

import numpy as np

from rigd.model.machine.kernel import kernel


@kernel
def mixed(word: np.uint64) -> np.uint64:
    """Return the splitmix64 finaliser of ``word`` (Steele, Lea, Flood 2014)."""
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return word ^ (word >> np.uint64(31))


@kernel
def normal_pair(seed: int, index: int) -> tuple[float, float]:
    """Return two standard normal numbers, a function of seed and index alone (Box-Muller).

    There is no generator with a state, so the noise at an instant does not depend on earlier calls.
    """
    golden = np.uint64(0x9E3779B97F4A7C15)
    first = mixed(mixed(np.uint64(seed) + golden) + np.uint64(index) * golden)
    second = mixed(first + golden)
    radius = math.sqrt(-2.0 * math.log((float(first >> np.uint64(11)) + 0.5) * 2.0**-53))
    angle = 2.0 * math.pi * float(second >> np.uint64(11)) * 2.0**-53
    return radius * math.cos(angle), radius * math.sin(angle)
