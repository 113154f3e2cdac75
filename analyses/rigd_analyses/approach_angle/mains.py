"""Finds the hum of the mains in the gauges and potentiometers of a run, and takes it off.

Hum in one amplitude looks like other faults: a torque that falls below a third of its mean 50 times
a second like a wheel that hops, the rest of it below 19 Hz like a short steady part, and in a
potentiometer like movement before the start. The mains differs from all of these in that it is one
line at 50 or 60 Hz with harmonics, there before the trigger, where nothing moves, and in the run.

The test fits the line (least squares, frequency free by 1.5 Hz) to what is faster than a mean over
one period, in the rest before the trigger and in the run. It is the mains if both show it, in about
one size, and the rest shows nothing like it 20 Hz beside (two bins of its 0.1 s). The usual hum of
good amplifiers, some per cent of the torque, is left: means over blocks hold whole periods of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd_analyses.approach_angle.better.settings import BetterSettings
from rigd_analyses.approach_angle.raw.flags import REST_S, whole
from rigd_analyses.approach_angle.raw.good_run_limits import Limits
from rigd_analyses.approach_angle.raw.run_data import (
    AngleCalibration,
    AngleRun,
    Flag,
    FloatArray,
    Severity,
)

#: Frequencies of mains, how far one may be off, and the steps in which it is sought, Hz.
MAINS_HZ: Final = (50.0, 60.0)
OFF_HZ: Final = 1.5
STEP_HZ: Final = 0.25
HARMONICS: Final = 3
#: Where the rest shows what is no line, Hz from it, and how many times smaller that is.
BESIDE_HZ: Final = 20.0
TIMES: Final = 3.0
#: The line of the run over that of the rest, at most, and at least the inverse.
RATIO: Final = 2.0
#: Of the torque, and of the least movement that counts as one: smaller hum changes nothing.
SHARE_OF_TORQUE: Final = 0.1
SHARE_OF_MOVEMENT: Final = 0.5


@dataclass(frozen=True, eq=False)
class _Signal:
    """What is fast in the volts (n,) of one signal, and where it rests and is driven, (n,)."""

    t_s: FloatArray
    fast: FloatArray
    rests: NDArray[np.bool_]
    driven: NDArray[np.bool_]
    window_s: float

    @staticmethod
    def of(run: AngleRun, volts: FloatArray, mains_hz: float) -> _Signal:
        """Return the signal less its means over one period of ``mains_hz``."""
        period_s = float(run.t_s[-1] - run.t_s[0]) / (run.t_s.size - 1)
        half = round(0.5 / (mains_hz * period_s))
        size = 2 * half + 1
        fast = volts - np.convolve(volts, np.full(size, 1.0 / size), mode="same")
        inside = np.zeros(volts.size, dtype=np.bool_)
        inside[half : volts.size - half] = True
        margin_s = half * period_s
        rests = inside & (run.t_s < REST_S - margin_s)
        driven = inside & (run.t_s > BetterSettings.start_s) & (run.t_s < run.stop_s - margin_s)
        return _Signal(run.t_s, fast, rests, driven, size * period_s)

    @property
    def tells(self) -> bool:
        """Whether the rest and the run last for a period at least."""
        counts = (int(np.count_nonzero(used)) for used in (self.rests, self.driven))
        return bool(min(counts) * (self.t_s[1] - self.t_s[0]) >= self.window_s)

    def line(self, used: NDArray[np.bool_], hz: float, count: int = 1) -> tuple[FloatArray, float]:
        """Return the ``count`` harmonics of ``hz`` in volts, (n,), and their power where used."""
        turns = hz * np.arange(1, count + 1)
        phase = 2.0 * math.pi * self.t_s[:, None] * turns
        basis = np.hstack([np.cos(phase), np.sin(phase)])
        kept = np.tile(1.0 - np.sinc(turns * self.window_s), 2)
        found = np.linalg.lstsq(basis[used] * kept, self.fast[used], rcond=None)[0]
        wave = np.asarray(basis @ found)
        return wave, float(np.mean(wave[used] ** 2))

    def mains_hz(self, nominal_hz: float) -> float:
        """Return the frequency of the line near ``nominal_hz`` that is strongest, to 0.1 Hz."""
        grid = nominal_hz + np.arange(-OFF_HZ, OFF_HZ + 0.5 * STEP_HZ, STEP_HZ)
        power = np.array([self.line(self.rests | self.driven, hz)[1] for hz in grid])
        at = int(np.clip(np.argmax(power), 1, grid.size - 2))
        low, top, high = power[at - 1 : at + 2]
        bend = low - 2.0 * top + high
        return float(grid[at] + (0.5 * STEP_HZ * (low - high) / bend if bend < 0.0 else 0.0))

    def amplitude_of_rest(self, hz: float) -> float:
        """Return the amplitude in V of ``hz`` before the trigger."""
        return math.sqrt(2.0 * self.line(self.rests, hz)[1])

    def amplitude(self, hz: float) -> float:
        """Return the amplitude in V of the mains at ``hz``; 0 if it is not the mains."""
        rest, run = (self.line(used, hz)[1] for used in (self.rests, self.driven))
        beside = max(self.line(self.rests, hz + off)[1] for off in (-BESIDE_HZ, BESIDE_HZ))
        if rest <= TIMES**2 * beside or not 1.0 / RATIO**2 <= run / rest <= RATIO**2:
            return 0.0
        return math.sqrt(2.0 * rest)


def without_mains(run: AngleRun, calibration: AngleCalibration, limits: Limits) -> AngleRun:
    """Return ``run`` without a hum that changes results, with a flag that names it."""
    start_s = BetterSettings.start_s
    if not whole(run) or not run.t_s[0] < -start_s < start_s < run.stop_s:
        return run
    torque = run.gauge_a_v - run.gauge_b_v
    level = abs(float(np.mean(torque[run.t_s > start_s]) - np.mean(torque[run.t_s < 0.0])))
    tested = (
        ("the gauges", torque, SHARE_OF_TORQUE * level, ("gauge_a_v", "gauge_b_v")),
        ("the wheel's potentiometer", run.wheel_v,
         SHARE_OF_MOVEMENT * limits.wheel_rad / abs(calibration.wheel.value), ("wheel_v",)),
        ("the platform's potentiometer", run.platform_v,
         SHARE_OF_MOVEMENT * limits.platform_m / abs(calibration.platform.value), ("platform_v",)),
    )  # fmt: skip
    cleaned: dict[str, FloatArray] = {}
    named = []
    for name, volts, least, fields in tested:
        for nominal_hz in MAINS_HZ:
            signal = _Signal.of(run, volts, nominal_hz)
            if not signal.tells or signal.amplitude_of_rest(nominal_hz) < 0.5 * least:
                continue
            hz = signal.mains_hz(nominal_hz)
            amplitude = signal.amplitude(hz)
            if amplitude < least:
                continue
            named.append(f"{name} {amplitude:.3f} V at {hz:.1f} Hz")
            for field in fields:
                part = _Signal.of(run, getattr(run, field), nominal_hz)
                wave, _ = part.line(part.rests | part.driven, hz, HARMONICS)
                cleaned[field] = getattr(run, field) - wave
            break
    if not named:
        return run
    flag = Flag(
        "mains_hum",
        f"Hum of the mains in {', '.join(named)}, before the relay command and in the run: a "
        "screen or an earth is off, or a cable lies beside one of the mains. It is taken off "
        "before anything is computed.",
        Severity.NOTE,
    )
    return replace(run, flags=(*run.flags, flag), **cleaned)  # type: ignore[arg-type]  # arrays
