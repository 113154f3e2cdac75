"""Samples the signals of the approach-angle plant, and returns blocks of samples as a card does."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from rigd.sdk.noise import normal_pair
from rigd_sim.approach_angle import layout
from rigd_sim.approach_angle.sampling import SAMPLING, sample

if TYPE_CHECKING:
    from rigd_sim.approach_angle.plant import AnglePlant

#: Added to the plant's seed: noise of samples and latency of blocks are series of their own.
_SAMPLES: Final = 1 << 40
_LATENCY: Final = 2 << 40


@dataclass(frozen=True, eq=False)
class Samples:
    """Consecutive samples: the number of the first one and volts of shape (n, inputs)."""

    first: int
    volts: NDArray[np.float64]


class Acquisition:
    """Samples all inputs of a plant from ``start_ns`` on (its clock), ``block`` at a time.

    A block can be had ``latency_s`` after its last sample on average: a fixed part and an
    exponential one of mean ``jitter_s``, which ends at ``layout.LATEST_JITTER`` times its mean.
    """

    def __init__(
        self,
        plant: AnglePlant,
        *,
        start_ns: int,
        rate_hz: float = 9600.0,
        block: int = 96,
        load_cell: bool = False,
        latency_s: float = 8e-3,
        jitter_s: float = 3e-3,
    ) -> None:
        self.plant = plant
        self.rate_hz = rate_hz
        self.block = block
        self._inputs = 5 if load_cell else 4
        self._constants = _constants(plant, rate_hz, self._inputs)
        self._fixed_s, self._jitter_s = latency_s - jitter_s, jitter_s
        self._first = math.ceil((start_ns - plant.origin_ns) * 1e-9 * rate_hz - 1e-6)
        self._blocks = 0
        self._due_ns = self._next_due_ns(0)
        # Compiles, or loads what was compiled before: the first block must not wait for it.
        sample(self._constants, plant.history, 0, 0, np.empty((0, self._inputs)))

    @property
    def due_ns(self) -> int:
        """When the next block can be had, on the plant's clock."""
        return self._due_ns

    def times_ns(self, samples: Samples) -> NDArray[np.int64]:
        """Return when the first input of each row was converted, on the plant's clock."""
        numbers = samples.first + np.arange(len(samples.volts))
        since_ns: NDArray[np.int64] = np.rint(numbers * (1e9 / self.rate_hz)).astype(np.int64)
        return self.plant.origin_ns + since_ns

    def read(self) -> Samples | None:
        """Return the next block, or None if the plant has not come that far.

        Raises:
            OverflowError: the plant has gone on so far that samples are lost.

        """
        if self.plant.now_ns < self._due_ns:
            return None
        oldest = self.plant.steps - layout.HISTORY_ROWS + 1
        if self._first * self._constants["steps_per_sample"][0] < oldest:
            held_s = layout.HISTORY_ROWS / layout.STEPS_PER_S
            raise OverflowError(f"samples were not read for {held_s:.1f} s and are lost")
        volts = np.empty((self.block, self._inputs))
        seed = self.plant.seed + _SAMPLES
        sample(self._constants, self.plant.history, seed, self._first, volts)
        samples = Samples(self._first, volts)
        self._first += self.block
        self._blocks += 1
        self._due_ns = self._next_due_ns(self._due_ns)
        return samples

    def read_due(self) -> Samples:
        """Return the next block, with the plant advanced to when it can be had."""
        self.plant.advance(max(self._due_ns, self.plant.now_ns))
        samples = self.read()
        if samples is None:
            raise RuntimeError("a block that is due can be had")
        return samples

    def _next_due_ns(self, not_before_ns: int) -> int:
        end_s = (self._first + self.block) / self.rate_hz
        a, b = normal_pair(self.plant.seed + _LATENCY, self._blocks)
        # Half the sum of two squares of normal numbers is exponential with mean 1.
        jitter = min(0.5 * (a * a + b * b), layout.LATEST_JITTER)
        late_s = self._fixed_s + self._jitter_s * jitter
        late_s = max(late_s, 1.0 / layout.STEPS_PER_S)  # what the skew looks ahead
        due_ns = self.plant.origin_ns + math.ceil((end_s + late_s) * 1e9)
        return max(due_ns, not_before_ns)


def _constants(plant: AnglePlant, rate_hz: float, inputs: int) -> NDArray[np.void]:
    p, noise = plant.parameters, plant.noise
    row = np.zeros(1, SAMPLING)
    volts_per_strain = p.gauges.sensitivity * noise
    row["rate_hz"] = rate_hz
    row["steps_per_sample"] = layout.STEPS_PER_S / rate_hz
    row["steps_per_scan"] = layout.STEPS_PER_S * p.card.scan * noise
    row["gauge_noise"] = p.gauges.noise * volts_per_strain
    row["pot_noise"] = p.potentiometers.noise * noise
    row["cell_noise"] = p.load_cell.noise * p.load_cell.sensitivity * noise
    row["hum"] = p.gauges.hum * volts_per_strain
    row["hum_correlation"] = p.gauges.hum_correlation
    row["resolution"] = p.card.resolution(inputs) * noise
    row["range"] = p.card.range
    return row
