"""Checks which samples of a recording are numbers that an acquisition card can return."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd_analyses.approach_angle.raw.run_data import FloatArray

#: No card gives more volts: a sample beyond is none, and sums of such samples overflow.
READABLE_V: Final = 100.0


def readable(volts: FloatArray) -> NDArray[np.bool_]:
    """Return which samples are numbers that a card can have given, (n,)."""
    return np.asarray(np.abs(volts) < READABLE_V)
