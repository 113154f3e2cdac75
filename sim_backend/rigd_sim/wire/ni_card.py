"""A simulated NI USB-6009: its ranges, codes, sample clock, buffer and faults; no gRPC.

One converter behind a multiplexer and an amplifier of gain 1 to 20: eight single-ended inputs of
±10 V, or four differential ones, ai0 to ai3, of ±20 V to ±1 V (NI USB-6008/6009 User Guide and
Specifications, 371303, "Analog Input"). 14 bits differential, 13 single-ended, 48 kS/s in all,
sample clock divided from 24 MHz ("Specifications").
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

TIMEBASE_HZ: Final = 24e6
MOST_SAMPLES_PER_S: Final = 48e3
INPUTS: Final = tuple(f"ai{index}" for index in range(8))
PAIRS: Final = INPUTS[:4]  #: inputs that can be differential
DIFFERENTIAL_RANGES_V: Final = (1.0, 1.25, 2.0, 2.5, 4.0, 5.0, 10.0, 20.0)
SINGLE_ENDED_RANGE_V: Final = 10.0
DIFFERENTIAL_CODES: Final = 2**14
SINGLE_ENDED_CODES: Final = 2**13
# What NI-DAQmx calls the ways to wire an input.
DEFAULT, SINGLE_ENDED, DIFFERENTIAL = -1, 10083, 10106
#: An open input picks up the mains.
MAINS_HZ: Final = 50.0
HUM_V: Final = 0.4

FloatArray = NDArray[np.float64]


class DaqFault(Exception):
    """A status that NI-DAQmx would give: a code of ``DAQmxErrors`` and words."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code


@dataclass(frozen=True)
class Span:
    """What the converter makes of one input: ±``range_v`` in so many ``codes``."""

    range_v: float
    codes: int


def span_for(channel: str, terminal: int, asked_v: float) -> Span:
    """Return the span that the card takes for ``asked_v``: its next larger one.

    ``terminal`` is one of NI-DAQmx's numbers; by default what can be is differential.

    Raises:
        DaqFault: there is no such input, or it cannot be wired or span so.
    """
    if channel not in INPUTS:
        raise DaqFault(-200170, f"Physical channel specified does not exist: {channel}")
    if terminal == DEFAULT:
        terminal = DIFFERENTIAL if channel in PAIRS else SINGLE_ENDED
    if terminal == DIFFERENTIAL and channel in PAIRS:
        fitting = [Span(one, DIFFERENTIAL_CODES) for one in DIFFERENTIAL_RANGES_V if one >= asked_v]
    elif terminal == SINGLE_ENDED and asked_v <= SINGLE_ENDED_RANGE_V:
        fitting = [Span(SINGLE_ENDED_RANGE_V, SINGLE_ENDED_CODES)]
    else:
        fitting = []
    if not fitting:
        raise DaqFault(-200077, "Requested value is not a supported value for this property.")
    return fitting[0]


def rate_for(asked_hz: float, inputs: int) -> float:
    """Return the rate that the card makes: 24 MHz over a whole number."""
    if not asked_hz > 0:
        raise DaqFault(-200077, "Requested value is not a supported value for this property.")
    if asked_hz * inputs > MOST_SAMPLES_PER_S:
        raise DaqFault(-200081, "Sample rate exceeds the maximum for the number of channels.")
    return TIMEBASE_HZ / round(TIMEBASE_HZ / asked_hz)


@dataclass
class Faults:
    """What the card and its server show at present; the fields are the names of the faults."""

    saturation: dict[str, float] = field(default_factory=dict)  #: input -> side, +1 or -1
    stuck_code: set[str] = field(default_factory=set)  #: inputs
    open_input: set[str] = field(default_factory=set)  #: inputs
    removal: bool = False
    short_block: bool = False
    drift: float | None = None  #: ppm, instead of the card's own
    stall: float = 0.0  #: s


class Acquisition:
    """The inputs of one task, converted continuously into a buffer.

    Args:
        inputs: their names and spans, in the order of conversion.
        rate_hz: nominal rate; the crystal's error comes on top.
        capacity: samples of each input that the buffer holds.
        noise_v: standard deviation of what the converter adds.
        start_ns: when the clock is started.
    """

    def __init__(
        self,
        inputs: Mapping[str, Span],
        rate_hz: float,
        capacity: int,
        *,
        noise_v: float,
        seed: int,
        start_ns: int,
    ) -> None:
        self.inputs = tuple(inputs)
        self.rate_hz = rate_hz
        self.overrun = False
        self.taken = 0  #: samples of each input handed over
        self.made = 0  #: samples of each input converted
        codes = np.array([one.codes for one in inputs.values()])[:, np.newaxis]
        self._step_v = np.array([[2 * one.range_v / one.codes] for one in inputs.values()])
        self._lowest, self._highest = -codes // 2, codes // 2 - 1
        self._noise_v = noise_v
        self._random = np.random.default_rng(seed)
        self._buffer = np.zeros((len(inputs), capacity))
        self._now_ns = start_ns
        self._phase = 0.0  # samples that the clock has run, whole and fraction
        self._volts: FloatArray | None = None

    @property
    def available(self) -> int:
        """Samples of each input that wait in the buffer."""
        return self.made - self.taken

    def advance(
        self, now_ns: int, volts: Mapping[str, Callable[[], float]], drift: float, faults: Faults
    ) -> None:
        """Convert what is due until ``now_ns``; between two calls voltages move on a line.

        ``drift`` is by which share the crystal runs fast. An input without a voltage is open.
        """
        now = np.array([volts[one]() if one in volts else 0.0 for one in self.inputs])
        before = now if self._volts is None else self._volts
        passed_s = (now_ns - self._now_ns) * 1e-9
        step = self.rate_hz * (1.0 + drift) * passed_s
        first, last = math.floor(self._phase) + 1, math.floor(self._phase + step)
        if last >= first:
            share: FloatArray = (np.arange(first, last + 1, dtype=np.float64) - self._phase) / step
            moving = before[:, np.newaxis] + (now - before)[:, np.newaxis] * share
            times_s = (self._now_ns * 1e-9) + share * passed_s
            self._store(self._converted(moving, times_s, volts, faults))
        self._phase += step
        self._now_ns, self._volts = now_ns, now

    def _converted(
        self,
        volts: FloatArray,
        times_s: FloatArray,
        connected: Mapping[str, object],
        faults: Faults,
    ) -> FloatArray:
        """Return what the converter makes of ``volts`` (inputs, n): codes, in V."""
        volts = volts + self._random.normal(0.0, self._noise_v, volts.shape)
        for index, name in enumerate(self.inputs):
            if name in faults.open_input or name not in connected:
                volts[index] = HUM_V * np.sin(2 * math.pi * MAINS_HZ * times_s)
            if name in faults.saturation:
                volts[index] = faults.saturation[name] * math.inf
        codes = np.rint(np.clip(volts / self._step_v, self._lowest, self._highest))
        converted: FloatArray = codes * self._step_v
        for index, name in enumerate(self.inputs):
            if name in faults.stuck_code and self.made:
                converted[index] = self._buffer[index, (self.made - 1) % self._buffer.shape[1]]
        return converted

    def _store(self, samples: FloatArray) -> None:
        capacity = self._buffer.shape[1]
        samples_kept = samples[:, -capacity:]
        count = samples.shape[1]
        first = self.made + count - samples_kept.shape[1]
        self._buffer[:, (first + np.arange(samples_kept.shape[1])) % capacity] = samples_kept
        self.made += count
        if self.available > capacity:
            self.overrun = True

    def take(self, count: int) -> FloatArray:
        """Return the oldest ``count`` samples of each input, shape (inputs, count).

        Raises:
            DaqFault: some were overwritten before they were fetched.
        """
        if self.overrun:
            raise DaqFault(
                -200279,
                "The application is not able to keep up with the hardware acquisition. Samples "
                "that were requested are no longer available.",
            )
        index = (self.taken + np.arange(count)) % self._buffer.shape[1]
        self.taken += count
        return self._buffer[:, index]
