"""What sensors make of a motion: when they look, what they show, and what goes wrong with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
KNEE = 0.8  #: in the unit of the sensor
TURN = 2.0 * np.pi * 0.02  #: of the measuring wheel, in m
RING_DAMPING = 0.05


@dataclass(frozen=True)
class Sensor:
    """One sensor, in the unit of what it shows; the defaults are those of a perfect one.

    It looks ``delay_s`` late, on a clock that gains ``drift`` and jitters by ``jitter_s``, behind a
    filter of first order at ``lowpass_hz``. What it sees is multiplied by ``gain``; ``zero``,
    ``fading`` for each second and a ``hum`` of 50 Hz are added, then white ``noise``; it is clipped
    at ``clip`` and shown in steps of ``count``. An encoder loses ``lost`` counts in each count
    (a share), and ``jump`` at once in the middle of the second trial. A share ``repeats`` of the
    samples shows the one before. Beyond ``KNEE`` it loses a share ``bend`` of what is more; its
    mount rings at ``ring_hz``; ``lines`` counts are missing in half of each ``TURN``.
    ``deadband`` at zero is not seen; it sees a share ``uneven`` less below zero, and ``square``
    times the square more. An ``alias`` of a switching frequency, at 24 Hz, comes with the reading;
    ``turns`` is an error once in 2 pi. It loses a share ``fast`` of what it turns faster than half
    its top speed, has a ``play``, and its clock steps by ``step_s`` in mid-trial.
    """

    noise: float = 0.0
    count: float = 0.0
    zero: float = 0.0
    delay_s: float = 0.0
    drift: float = 0.0
    jitter_s: float = 0.0
    lowpass_hz: float = 0.0
    gain: float = 1.0
    fading: float = 0.0
    hum: float = 0.0
    clip: float = np.inf
    lost: float = 0.0
    jump: float = 0.0
    repeats: float = 0.0
    bend: float = 0.0
    ring_hz: float = 0.0
    lines: float = 0.0
    deadband: float = 0.0
    uneven: float = 0.0
    square: float = 0.0
    alias: float = 0.0
    fast: float = 0.0
    play: float = 0.0
    step_s: float = 0.0
    turns: float = 0.0

    def show(
        self, t: FloatArray, values: FloatArray, at: FloatArray, trial: int,
        rng: np.random.Generator, offset: float = 0.5,
    ) -> FloatArray:  # fmt: skip
        """Return what is shown at ``at`` (n,) of ``values`` (k,) at the finer times ``t`` (k,).

        ``trial`` counts from 0; ``offset`` is where between two counts zero lies.
        """
        when = at * (1.0 + self.drift) - self.delay_s
        when = when - self.step_s * (at > 0.5 * at[-1])
        if self.jitter_s:
            when = when + self.jitter_s * rng.standard_normal(len(at))
        if self.lowpass_hz:
            values = _lowpass(values, 2.0 * np.pi * self.lowpass_hz * float(t[1] - t[0]))
        if self.ring_hz:
            values = _ringing(values, self.ring_hz, float(t[1] - t[0]))
        if self.play:
            values = _with_play(values, self.play)
        if self.fast:
            speed = np.abs(np.gradient(values, t))
            lost = self.fast * np.maximum(speed - 0.5 * np.max(speed), 0.0)
            values = values - np.cumsum(lost) * float(t[1] - t[0])
        seen = np.interp(when, t, values)
        seen = seen * (1.0 - self.uneven * (seen < 0.0)) + self.square * seen * np.abs(seen)
        seen = np.sign(seen) * np.maximum(np.abs(seen) - self.deadband, 0.0)
        seen = (
            seen + self.turns * np.sin(seen) + self.alias * np.tanh(seen / 0.1) * np.sin(150.0 * at)
        )
        shown = self.gain * seen + self.zero + self.fading * at
        shown = shown - self.bend * np.sign(shown) * np.maximum(np.abs(shown) - KNEE, 0.0)
        shown = shown - self.lines * self.count * (np.mod(shown + 0.25 * TURN, TURN) > 0.5 * TURN)
        shown = shown + self.hum * np.sin(2.0 * np.pi * 50.0 * at + trial)
        shown = np.clip(shown + self.noise * rng.standard_normal(len(at)), -self.clip, self.clip)
        if self.lost:
            counts = np.abs(np.diff(shown, prepend=shown[0])) / self.count
            shown = shown - self.count * np.cumsum(rng.random(len(at)) < self.lost * counts)
        if self.jump and trial == 1:
            shown = shown + self.jump * (np.arange(len(at)) > len(at) // 2)
        if self.count:
            shown = np.floor(shown / self.count + offset) * self.count
        if self.repeats:
            fresh = rng.random(len(at)) >= self.repeats
            fresh[0] = True
            shown = shown[np.maximum.accumulate(np.where(fresh, np.arange(len(at)), 0))]
        return np.asarray(shown)


def _with_play(values: FloatArray, play: float) -> FloatArray:
    """Return what follows ``values`` through a play: it moves only at either end."""
    out = np.empty_like(values)
    last = values[0]
    for k, value in enumerate(values):
        last = min(max(last, value - 0.5 * play), value + 0.5 * play)
        out[k] = last
    return out


@dataclass(frozen=True)
class Logger:
    """What becomes of all channels together between the sensors and the file.

    Each is averaged over ``smooth_s``; only one sample in each ``coarse_s`` is kept, with lines
    between; ``digits`` significant ones are written; for 50 ms in each 0.3 s rows are read
    ``burst_s`` late; each 0.25 s rows stand still for ``frozen_s``; the clock is ``slow`` by this
    share, and reads ``late_s`` behind the steps of the command.
    """

    smooth_s: float = 0.0
    coarse_s: float = 0.0
    digits: float = 0.0
    burst_s: float = 0.0
    frozen_s: float = 0.0
    slow: float = 0.0
    late_s: float = 0.0

    def times(self, at: FloatArray) -> FloatArray:
        """Return when rows are read that are stamped ``at``."""
        when = at + self.slow * (at - 0.35) + self.late_s - self.burst_s * (np.mod(at, 0.3) < 0.05)
        if self.frozen_s:
            begun = np.floor(at / 0.25) * 0.25
            when = np.where((at - begun < self.frozen_s) & (begun > 0.0), begun, when)
        return when

    def write(self, at: FloatArray, shown: FloatArray) -> FloatArray:
        """Return what stands in the file of ``shown`` (n,) at ``at`` (n,)."""
        period = float(at[1] - at[0])
        if self.smooth_s:
            width = round(self.smooth_s / period)
            padded = np.pad(shown, (width - 1, 0), mode="edge")
            shown = np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
        if self.coarse_s:
            every = round(self.coarse_s / period)
            shown = np.interp(at, at[::every], shown[::every])
        if self.digits:
            size = np.maximum(np.abs(shown), 1e-30)
            unit = 10.0 ** (np.floor(np.log10(size)) - self.digits + 1.0)
            shown = np.round(shown / unit) * unit
        return shown


def _lowpass(values: FloatArray, step: float) -> FloatArray:
    """Return ``values`` behind a filter of first order, ``step`` of its time constants apart."""
    from scipy.signal import lfilter, lfilter_zi

    share = 1.0 - np.exp(-step)
    taps = ([share], [1.0, share - 1.0])
    return np.asarray(lfilter(*taps, values, zi=values[0] * lfilter_zi(*taps))[0])


def _ringing(values: FloatArray, ring_hz: float, period_s: float) -> FloatArray:
    """Return ``values`` on a mount of second order that rings at ``ring_hz``."""
    from scipy.signal import bilinear, lfilter, lfilter_zi

    rate = 2.0 * np.pi * ring_hz
    taps = bilinear([rate**2], [1.0, 2.0 * RING_DAMPING * rate, rate**2], 1.0 / period_s)
    return np.asarray(lfilter(*taps, values, zi=values[0] * lfilter_zi(*taps))[0])
