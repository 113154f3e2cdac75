"""Finds the gains of a PI controller from swings of a relay.

What was set and what was measured are compared at the frequency of the swing itself, by their first
Fourier coefficients over whole swings: that is a point of the frequency response of the rig as the
controller meets it, sampling, filters and delays included, and needs no approximation of the relay
by a describing function (K. J. Astrom and T. Hagglund, Advanced PID Control, 2006, section 8.3).
The gain of the rig there is 1/Ku, the period Tu. The rule is that of B. D. Tyreus and W. L. Luyben,
Ind. Eng. Chem. Res. 31 (1992) 2625, for a PI controller: kp = Ku / 3.2, ki = kp / (2.2 Tu).

The hysteresis makes the swing slower than the ultimate one, at which the lag is 180 degrees. There
the gain of the rig is larger and the period longer, so that both gains come out smaller.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from rigd.analysis import quotient
from rigd.analysis.calibration.result import CalibrationResult, Contribution, Measured, Series
from rigd.analysis.recordings.source import RecordedSweep
from rigd.analysis.result import FloatArray

#: Swings at the start that are left out: the middle of the output is still being found.
SETTLING: Final = 2
#: Swings that are needed besides: with fewer their scatter is not known.
LEAST_SWINGS: Final = 6
#: Different readings in a swing: with fewer the controller could not follow it.
LEAST_READINGS: Final = 8
#: Most scatter of period and amplitude between swings, as a share.
MOST_SCATTER: Final = 0.2
#: Share of a swing that the output may be above its middle.
DUTY: Final = (0.3, 0.7)
#: Lags in degrees that show a rig which only integrates.
INTEGRATOR: Final = (75.0, 105.0)
#: The lag at the swing, in degrees: at 135 the hysteresis is 0.7 of the amplitude of the swing.
LAG: Final = (135.0, 200.0)
#: Ultimate gain over kp, and integral time over the ultimate period (Tyreus and Luyben).
GAIN_RATIO: Final = 3.2
TIME_RATIO: Final = 2.2

TITLE: Final = "Gains by a relay"


@dataclass(frozen=True, eq=False)
class Swings:
    """Whole swings after the first ones: of each its place, amplitudes and share.

    ``starts`` and ``counts`` (n,) are in samples; ``measured`` and ``output`` (n,) the complex
    amplitudes at the frequency of the swing, in SI; ``duty`` (n,) is the share above the middle,
    ``readings`` (n,) the number of different readings.
    """

    starts: FloatArray
    counts: FloatArray
    measured: np.typing.NDArray[np.complex128]
    output: np.typing.NDArray[np.complex128]
    duty: FloatArray
    readings: FloatArray


def gains_of(sweep: RecordedSweep) -> CalibrationResult:
    """Return the gains that the trials of ``sweep`` give, or the reasons against them.

    Raises:
        DataError: a signal was not recorded, or too many of its samples are missing.
    """
    found, series, refusals = [], [], []
    for trial in sweep.trials:
        t_s, signals = sweep.signals(trial)
        measured, output, relay = (signals[name] for name in ("measured", "output", "relay"))
        why = no_relay(relay)
        if why:
            refusals.append(f"trial {trial.number}: {why}")
            continue
        swings = swings_of(measured, output, relay)
        why = unsteady(swings)
        if why:
            refusals.append(f"trial {trial.number}: {why}")
            continue
        found.append((swings, t_s[1] - t_s[0]))
        series += _drawn(t_s, measured, output, swings, _units(sweep))
    if refusals:
        return CalibrationResult(
            TITLE, {}, refusals=tuple(refusals), series=tuple(series), kind="tuning"
        )
    return _result(found, series, _units(sweep))


def no_relay(relay: FloatArray) -> str:
    """Return why ``relay`` (n,), a term of a controller, is not a relay; "" if it is."""
    if not np.all(np.isfinite(relay)):
        return "the signal 'relay' has samples that are no numbers"
    acting = np.abs(relay[relay != 0.0])
    if not len(acting):
        return "the relay did not act: set its controller in a step"
    if np.ptp(acting) > 1e-6 * np.max(acting):
        return (
            "the signal 'relay' has more than two values: it is the proportional term of a "
            "controller with 'relay' in place of gains"
        )
    return ""


def swings_of(measured: FloatArray, output: FloatArray, relay: FloatArray) -> Swings:
    """Return the whole swings in which the relay acts, without the first ones after it began.

    All are (n,) samples at regular times; a swing begins where ``relay`` becomes positive.
    """
    begins = np.flatnonzero((relay[1:] > 0.0) & (relay[:-1] < 0.0)) + 1
    spans, since = [], 0
    for first, last in pairwise(begins):
        since = since + 1 if np.all(relay[first:last] != 0.0) else 0
        if since > SETTLING:
            spans.append((first, last))
    rows = [
        (
            first,
            last - first,
            _first_harmonic(measured[first:last]),
            _first_harmonic(output[first:last]),
            np.mean(relay[first:last] > 0.0),
            np.count_nonzero(np.diff(measured[first:last])) + 1,
        )
        for first, last in spans
    ]
    columns = list(zip(*rows, strict=True)) or [()] * 6
    starts, counts, duty, readings = (np.array(columns[n], float) for n in (0, 1, 4, 5))
    y, u = (np.array(columns[n], complex) for n in (2, 3))
    return Swings(starts, counts, y, u, duty, readings)


def unsteady(swings: Swings) -> str:
    """Return why ``swings`` give no gains; "" if they do."""
    count = len(swings.counts)
    if count < LEAST_SWINGS:
        return (
            f"{count} whole swings after the first {SETTLING}, at least {LEAST_SWINGS} are needed: "
            "let the relay act for longer"
        )
    if not (np.all(np.isfinite(swings.measured)) and np.all(np.isfinite(swings.output))):
        return "measured or output has samples that are no numbers"
    readings = float(np.median(swings.readings))
    if readings < 2:
        return "the measured value stays the same in a swing: is it what the controller measures?"
    if np.any(np.abs(swings.output) == 0.0):
        return "the output stays the same in a swing: is it what was set?"
    if readings < LEAST_READINGS:
        return (
            f"a swing has {readings:.0f} different readings, at least {LEAST_READINGS} are needed: "
            "read the channel more often, or give a larger hysteresis"
        )
    for name, values in (("period", swings.counts), ("amplitude", np.abs(swings.measured))):
        scatter = float(np.std(values, ddof=1) / np.mean(values))
        if scatter > MOST_SCATTER:
            return (
                f"the {name} of the swings scatters by {scatter:.0%}, more than "
                f"{MOST_SCATTER:.0%}: give a hysteresis above the noise, or a larger relay"
            )
    duty = float(np.mean(swings.duty))
    if not DUTY[0] <= duty <= DUTY[1]:
        return (
            f"the output is above its middle for {duty:.0%} of a swing: give a smaller relay, or "
            "begin at the output that the setpoint needs; its limits may hold the middle"
        )
    lag = _lag(complex(np.mean(swings.measured / swings.output)))
    if LAG[0] <= lag <= LAG[1]:
        return ""
    integrates = INTEGRATOR[0] <= lag <= INTEGRATOR[1]
    return (
        f"the measured value lags by {lag:.0f} degrees behind the output at the swing, gains "
        f"need {LAG[0]:.0f} to {LAG[1]:.0f}: give a smaller hysteresis or a larger relay; "
        + (
            "if it then stays near 90 degrees the rig integrates, as a force by a speed does, and "
            "no relay finds gains: set kp to 1 / (slope of the measured value per output * time "
            "in which an error shall fade)"
            if integrates
            else "check that 'output' is what was set and 'measured' what the controller measures"
        )
    )


def _result(
    trials: Sequence[tuple[Swings, float]], series: Sequence[Series], units: tuple[str, str]
) -> CalibrationResult:
    """Return the gains from the swings of each of ``trials`` and its time per sample in s.

    ``units`` are those of measured and output.
    """
    measured, output = units
    response = np.concatenate([swings.measured / swings.output for swings, _ in trials])
    period_s = np.concatenate([swings.counts * step_s for swings, step_s in trials])
    middle = complex(np.mean(response))
    sign = -1.0 if middle.real > 0.0 else 1.0
    ultimate_gain = sign / abs(middle)
    # Shares: of the projection on the mean, so that a scatter of phase does not count.
    shares = np.real(response / middle)
    ultimate_period_s = float(np.mean(period_s))
    # The first and the last swing begin within a cycle each: a triangular distribution (GUM 4.3.9).
    longest_s = max(step_s for _, step_s in trials)
    cycle = longest_s / math.sqrt(6.0) / len(period_s) / ultimate_period_s
    u_gain = _scatter(shares)
    u_period = {**_scatter(period_s / ultimate_period_s), "length of a cycle": cycle}
    kp = ultimate_gain / GAIN_RATIO
    ki = kp / (TIME_RATIO * ultimate_period_s)
    gain_unit, rate_unit = quotient(output, measured), quotient(output, f"{measured} s")
    swing = float(np.mean(np.concatenate([np.abs(swings.measured) for swings, _ in trials])))
    moved = float(np.mean(np.concatenate([np.abs(swings.output) for swings, _ in trials])))
    facts = (
        f"{len(period_s)} swings of {1e3 * ultimate_period_s:.4g} ms: the output with an amplitude "
        f"of {moved:.3g} {output}, the measured value with {swing:.3g} {measured}, "
        f"{_lag(middle):.0f} degrees later",
        f"write into the rig file, in place of relay and hysteresis: kp: {_two_digits(kp)} "
        f"{gain_unit}, ki: {_two_digits(ki)} {rate_unit}",
        "they hold near this setpoint and amplitude: friction and gears answer otherwise to others",
    )
    return CalibrationResult(
        TITLE,
        {
            "ultimate_gain": Measured(ultimate_gain, gain_unit, _budget(ultimate_gain, u_gain)),
            "ultimate_period": Measured(
                ultimate_period_s, "s", _budget(ultimate_period_s, u_period)
            ),
            "kp": Measured(kp, gain_unit, _budget(kp, u_gain)),
            "ki": Measured(
                ki, rate_unit, (*_budget(ki, u_gain), *_budget(ki, u_period, "period, "))
            ),
        },
        facts,
        series=tuple(series),
        kind="tuning",
    )


def _scatter(shares: FloatArray) -> dict[str, float]:
    """Return the terms of the standard uncertainty of a mean of ``shares`` (n,), as shares."""
    half = len(shares) // 2
    drift = abs(float(np.mean(shares[:half]) - np.mean(shares[half:])))
    return {
        "scatter between swings": float(np.std(shares, ddof=1)) / math.sqrt(len(shares)),
        "drift over the swings": drift / (2 * math.sqrt(3.0)),
    }


def _budget(
    value: float, shares: Mapping[str, float], prefix: str = ""
) -> tuple[Contribution, ...]:
    """Return the terms of the standard uncertainty of ``value``, from their shares of it."""
    return tuple(Contribution(f"{prefix}{name}", abs(value) * u) for name, u in shares.items())


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):.12g}"


def _lag(response: complex) -> float:
    """Return by how many degrees the measured value lags, for a rig that answers upwards."""
    lag = -math.degrees(math.atan2(response.imag, response.real))
    if response.real > 0.0:  # more output lowers the measured value
        lag += 180.0
    return lag % 360.0


def _first_harmonic(values: FloatArray) -> complex:
    """Return the complex amplitude of the first harmonic of ``values`` (n,), one whole swing."""
    turn = np.exp(-2j * np.pi * np.arange(len(values)) / len(values))
    return complex(2.0 * np.mean(values * turn))


def _units(sweep: RecordedSweep) -> tuple[str, str]:
    """Return the units of measured and output."""
    units = []
    for signal in ("measured", "output"):
        stream, name = sweep.field(signal)
        units.append(next(c.unit for c in stream.channels if c.name == name))
    return units[0], units[1]


def _drawn(
    t_s: FloatArray,
    measured: FloatArray,
    output: FloatArray,
    swings: Swings,
    units: tuple[str, str],
) -> list[Series]:
    """Return the last swings of measured and output beside their first harmonics."""
    series = []
    ends = swings.starts + swings.counts
    pauses = np.flatnonzero(swings.starts[1:] != ends[:-1]) + 1
    shown = slice(int(np.max(pauses, initial=len(ends) - 3)), None)
    starts, counts = swings.starts[shown].astype(int), swings.counts[shown].astype(int)
    rows = slice(starts[0], starts[-1] + counts[-1])
    for name, values, amplitudes, unit in (
        ("measured", measured, swings.measured[shown], units[0]),
        ("output", output, swings.output[shown], units[1]),
    ):
        fitted = np.concatenate([
            np.mean(values[start : start + count])
            + np.real(amplitude * np.exp(2j * np.pi * np.arange(count) / count))
            for start, count, amplitude in zip(starts, counts, amplitudes, strict=True)
        ])  # fmt: skip
        series.append(
            Series(
                f"{name}: the last swings",
                "time, s",
                f"{name}, {unit}",
                t_s[rows],
                values[rows],
                fitted,
            )
        )
    return series
