"""Simulates an NI USB-6009: ranges, codes, sample clock, buffer and faults; no gRPC.

The card has one converter behind a multiplexer and an amplifier of gain 1 to 20. The inputs are
eight single-ended inputs of ±10 V, or four differential inputs, ai0 to ai3, of ±20 V to ±1 V (NI
USB-6008/6009 User Guide and Specifications, 371303, "Analog Input"). The resolution is 14 bits
differential and 13 bits single-ended. The rate is 48 kS/s for all inputs together, with a sample
clock that is divided from 24 MHz ("Specifications").
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, field
from typing import Final, Protocol

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
    """The range of the converter for one input: ±``range_v`` in so many ``codes``."""

    range_v: float
    codes: int

    @property
    def step_v(self) -> float:
        """Volts between two codes."""
        return 2 * self.range_v / self.codes


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
        fitting = [
            Span(item, DIFFERENTIAL_CODES) for item in DIFFERENTIAL_RANGES_V if item >= asked_v
        ]
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
    """The faults that the card and its server have now; the fields are their names."""

    saturation: dict[str, float] = field(default_factory=dict)  #: input -> side, +1 or -1
    stuck_code: set[str] = field(default_factory=set)  #: inputs
    open_input: set[str] = field(default_factory=set)  #: inputs
    removal: bool = False
    short_block: bool = False
    drift: float | None = None  #: ppm, instead of the card's own
    stall: float = 0.0  #: s


class Sampler(Protocol):
    """Samples the inputs of one task, from the moment that its clock was started."""

    def due(self, now_ns: int, drift: float) -> FloatArray:
        """Return the samples that fell due since the last call, shape (inputs, n), in V.

        ``drift`` is by which share the crystal runs fast.

        Raises:
            OverflowError: it was asked so late that samples are lost.
        """
        ...


#: ``sample(inputs, rate_hz, start_ns)`` begins to sample the inputs of those names and spans.
Sampling = Callable[[Mapping[str, Span], float, int], Sampler]


class Following:
    """Samples voltages that are known at some times, and interpolates linearly between them.

    Args:
        inputs: their names and spans, in the order of conversion.
        rate_hz: nominal rate; the crystal's error comes on top.
        start_ns: when the clock is started.
        volts: what is at an input; one that has none is at 0 V.
        noise_v: standard deviation of what the converter adds.
        seed: of that.
    """

    def __init__(
        self,
        inputs: Mapping[str, Span],
        rate_hz: float,
        start_ns: int,
        *,
        volts: Mapping[str, Callable[[], float]],
        noise_v: float,
        seed: int,
    ) -> None:
        self._sources = [volts.get(item, lambda: 0.0) for item in inputs]
        self._rate_hz = rate_hz
        self._step_v = np.array([[item.step_v] for item in inputs.values()])
        self._noise_v = noise_v
        self._random = np.random.default_rng(seed)
        self._now_ns = start_ns
        self._phase = 0.0  # samples that the clock has run, whole and fraction
        self._volts: FloatArray | None = None

    def due(self, now_ns: int, drift: float) -> FloatArray:
        """Return what fell due; see :meth:`Sampler.due`."""
        now = np.array([volts() for volts in self._sources])
        before = now if self._volts is None else self._volts
        step = self._rate_hz * (1.0 + drift) * (now_ns - self._now_ns) * 1e-9
        first, last = math.floor(self._phase) + 1, math.floor(self._phase + step)
        moving = np.zeros((len(now), 0))
        if last >= first:
            share = (np.arange(first, last + 1, dtype=np.float64) - self._phase) / step
            moving = before[:, np.newaxis] + (now - before)[:, np.newaxis] * share
        self._phase += step
        self._now_ns, self._volts = now_ns, now
        noisy = moving + self._random.normal(0.0, self._noise_v, moving.shape)
        codes: FloatArray = np.rint(noisy / self._step_v) * self._step_v
        return codes


class Acquisition:
    """The inputs of one task, converted continuously into a buffer.

    Args:
        inputs: their names and spans, in the order of conversion.
        rate_hz: nominal rate.
        capacity: samples of each input that the buffer holds.
        sampler: gives what the converter makes of them.
        connected: names of the inputs that something is wired to; others are open.
    """

    def __init__(
        self,
        inputs: Mapping[str, Span],
        rate_hz: float,
        capacity: int,
        sampler: Sampler,
        connected: Container[str],
    ) -> None:
        self.inputs = tuple(inputs)
        self.rate_hz = rate_hz
        self.overrun = False
        self.taken = 0  #: samples of each input handed over
        self.made = 0  #: samples of each input converted
        self._lowest = np.array([[-item.range_v] for item in inputs.values()])
        self._highest = np.array([[item.range_v - item.step_v] for item in inputs.values()])
        self._step_v = [item.step_v for item in inputs.values()]
        self._sampler = sampler
        self._connected = connected
        self._buffer = np.zeros((len(inputs), capacity))

    @property
    def available(self) -> int:
        """Samples of each input that wait in the buffer."""
        return self.made - self.taken

    def advance(self, now_ns: int, drift: float, faults: Faults) -> None:
        """Convert what is due until ``now_ns``; ``drift`` as in :meth:`Sampler.due`."""
        try:
            samples = self._sampler.due(now_ns, drift)
        except OverflowError:
            self.overrun = True
            return
        if samples.shape[1]:
            self._store(self._spoiled(samples, faults))

    def _spoiled(self, volts: FloatArray, faults: Faults) -> FloatArray:
        """Return ``volts`` (inputs, n) within their ranges, with what the faults make of them."""
        times_s = (self.made + np.arange(volts.shape[1])) / self.rate_hz
        for index, name in enumerate(self.inputs):
            if name in faults.open_input or name not in self._connected:
                hum = HUM_V * np.sin(2 * math.pi * MAINS_HZ * times_s)
                volts[index] = np.rint(hum / self._step_v[index]) * self._step_v[index]
            if name in faults.saturation:
                volts[index] = faults.saturation[name] * math.inf
            if name in faults.stuck_code and self.made:
                volts[index] = self._buffer[index, (self.made - 1) % self._buffer.shape[1]]
        clipped: FloatArray = np.clip(volts, self._lowest, self._highest)
        return clipped

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
