"""Samples the plant's voltages as a data acquisition card does: noise, skew and quantisation.

A sample depends only on the history of the plant, the seed and the number of the sample. It does
not depend on the time at which the sample is computed.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rigd.model.machine.kernel import kernel
from rigd.sdk.noise import normal_pair

Row = Any
Floats = NDArray[np.float64]
#: Constants of the card and of what disturbs its inputs, in volts.
SAMPLING: Final = np.dtype(
    [
        (name, np.float64)
        for name in (
            *("steps_per_sample", "steps_per_scan", "rate_hz", "gauge_noise", "pot_noise"),
            *("cell_noise", "hum", "hum_correlation", "resolution", "range"),
        )
    ]
)

#: Frequency of the mains in Hz.
MAINS_HZ: float = 50.0


@kernel
def converted(c: Row, volts: float) -> float:
    """Return ``volts`` as the converter gives them."""
    if c.resolution > 0.0:
        volts = math.floor(volts / c.resolution + 0.5) * c.resolution
    limited: float = min(max(volts, -c.range), c.range)
    return limited


@kernel
def sample(
    constants: NDArray[np.void], history: Floats, seed: int, first: int, volts: Floats
) -> None:
    """Fill ``volts`` (samples, inputs) from sample number ``first`` on.

    The history must hold the steps up to two after the last sample's.
    """
    c = constants[0]
    rows = history.shape[0]
    count, inputs = volts.shape
    for k in range(count):
        number = first + k
        gauge_a, gauge_b = normal_pair(seed, 3 * number)
        wheel, platform = normal_pair(seed, 3 * number + 1)
        phase = 2.0 * math.pi * MAINS_HZ * (number / c.rate_hz)
        both, alone = c.hum_correlation, math.sqrt(1.0 - c.hum_correlation * c.hum_correlation)
        hum = c.hum * math.sin(phase)
        hum_b = both * hum + alone * c.hum * math.cos(phase)
        for item in range(inputs):
            place = number * c.steps_per_sample + item * c.steps_per_scan
            step = math.floor(place)
            share = place - step
            value = history[int(step) % rows, item]
            if share > 0.0:
                value += share * (history[(int(step) + 1) % rows, item] - value)
            if item == 0:
                value += hum + c.gauge_noise * gauge_a
            elif item == 1:
                value += hum_b + c.gauge_noise * gauge_b
            elif item == 2:
                value += c.pot_noise * wheel
            elif item == 3:
                value += c.pot_noise * platform
            else:
                value += c.cell_noise * normal_pair(seed, 3 * number + 2)[0]
            volts[k, item] = converted(c, value)
