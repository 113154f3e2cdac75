"""Flags faults in the raw data of a run, before anything is computed from the run.

One broken wire or one forgotten weight gives a friction coefficient that looks good. Each check
here tests a run for one such fault; its flag states what was found and what was expected:

===================  ========  ====================================================================
code                 severity  found when
===================  ========  ====================================================================
no_pre_trigger       excluded  less than 50 ms before the relay command: t = 0 and the zero of the
                               gauges cannot be checked, and the zero's drift is 4.5 % of mu
too_short            excluded  less than 0.15 s from command to stop, or the record ends before it
nan_samples          excluded  a signal has samples that are no number, or that no card can give
missing_samples      excluded  a gap in the times: for filters and the Fourier step it is a jump
at_rail              excluded  a signal is at the limit of the converter
stuck_samples        excluded  a gauge repeats one value for longer than its noise allows
noisy                excluded  a signal has many times its usual noise: a broken wire or screen
moving_at_start      excluded  wheel or platform moves before the command: not at rest, no tare
watchdog             excluded  the watchdog time stopped the run, not the travel
load_missing         excluded  no reading of the scale, or none that is a load
scale_unsteady       excluded  the reading of the scale had not come to rest
load_disagrees       excluded  the reading is not the load that was announced
load_cell_disagrees  excluded  the load cell does not show what the scale shows
no_drive             excluded  neither torque nor movement: the motor did not run
no_torque            excluded  movement without torque: the gauges' amplifier is off
gauges_off_zero      excluded  the gauges show torque before the command, when nothing drives; the
                               paper's method subtracts no zero
negative_torque      excluded  torque below 0 in the first 100 ms: the gauges are swapped
gauges_disagree      excluded  one gauge does not show the torque, or reversed: T is too small
negative_speed       excluded  wheel or platform runs backwards: potentiometer leads swapped
pot_dead             excluded  a potentiometer stands still while the gauges show torque
pot_jumps            excluded  a potentiometer moves faster than anything on the rig: wiper, thread
pot_at_end           excluded  a potentiometer is at the end of its ten turns (it does not wrap)
pot_near_end         note      it did not reach its end, but a run could have
===================  ========  ====================================================================

"Excluded" means that no number of the run could be defended; with a "note" the numbers stand. The
analysis corrects no sign and swaps no leads: if the wiring is wrong, other faults of the wiring are
possible and unknown.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.recordings.noise import white_noise
from rigd_analyses.approach_angle.raw.good_run_limits import Limits
from rigd_analyses.approach_angle.raw.load_flags import load_flags
from rigd_analyses.approach_angle.raw.run_data import (
    AngleCalibration,
    AngleRig,
    AngleRun,
    Flag,
    FloatArray,
    Severity,
)
from rigd_analyses.approach_angle.raw.samples import readable

#: The relay takes 8 ms to pick up: until this time after the command all is at rest.
REST_S = 0.005
#: Fewer samples than these between command and stop cannot be computed with at all.
FEWEST_SAMPLES = 100
#: The end of a range counts from this many samples on; one is a spike.
AT_END_SAMPLES = 10
#: A signal with less noise than so many steps of the converter repeats values by itself.
QUIET = 2.0
#: Less noise than this is that of a simulation: amplifiers and wires have more.
QUIET_V = 1e-4
#: Repetitions that are no news in any signal, and the chance of more in a whole run.
LEAST_STUCK, CHANCE = 8, 1e-9
#: Speeds of potentiometers are judged over so long, s.
JUMP_S = 0.0025


@dataclass(frozen=True, eq=False)
class _Pot:
    """One potentiometer up to the stop; its movement is in ``unit``."""

    name: str
    unit: str
    t_s: FloatArray
    volts: FloatArray
    scale: float  #: ``unit`` per V
    least: float  #: less movement than this is none
    room: float  #: movement that a run may need

    def moved(self, start_s: float, end_s: float) -> float:
        """Return the movement from one time to another, each over 5 ms."""
        return self.scale * (
            _level(self.t_s, self.volts, end_s) - _level(self.t_s, self.volts, start_s)
        )


def raw_flags(
    run: AngleRun, calibration: AngleCalibration, rig: AngleRig, limits: Limits | None = None
) -> tuple[Flag, ...]:
    """Return what is wrong with ``run``: what its recording reports, then what is found here.

    Empty for a good run. Signals that are not :func:`whole` are judged no further. That a run which
    was never driven has no samples of a drive is not reported twice.
    """
    limits = Limits() if limits is None else limits
    known = {flag.code for flag in run.flags}
    found = [] if "not_driven" in known else list(_record(run, limits))
    found += load_flags(run, calibration, rig, limits)
    if whole(run):
        found += _signals(run, calibration, limits)
    return (*run.flags, *(flag for flag in found if flag.code not in known))


def driven(run: AngleRun) -> NDArray[np.bool_]:
    """Return which samples lie between the relay command and the stop command, (n,)."""
    return (run.t_s >= 0.0) & (run.t_s <= run.stop_s)


def whole(run: AngleRun) -> bool:
    """Return whether a run can be computed with: enough samples, all numbers, times that rise."""
    used = run.t_s <= run.stop_s
    return (
        int(np.count_nonzero(driven(run))) >= FEWEST_SAMPLES
        and bool(np.all(np.isfinite(run.t_s)))
        and bool(np.all(np.diff(run.t_s[used]) > 0.0))
        and all(bool(np.all(readable(volts[used]))) for volts in _volts(run).values())
    )


def _volts(run: AngleRun) -> dict[str, FloatArray]:
    return {
        "gauge a": run.gauge_a_v,
        "gauge b": run.gauge_b_v,
        "the wheel's potentiometer": run.wheel_v,
        "the platform's potentiometer": run.platform_v,
    }


def _record(run: AngleRun, limits: Limits) -> Iterator[Flag]:
    if run.t_s.size == 0:
        yield Flag("too_short", "The recording holds no samples of this run.")
        return
    if bad := int(np.count_nonzero(~np.isfinite(run.t_s))):
        yield Flag("nan_samples", f"The times of {bad} of {run.t_s.size} samples are no numbers.")
        return
    first, last = float(run.t_s[0]), float(run.t_s[-1])
    if first > -limits.pre_trigger_s:
        where = "before" if first <= 0.0 else "after"
        yield Flag(
            "no_pre_trigger",
            f"The record begins {1e3 * abs(first):.0f} ms {where} the relay command, need "
            f"{1e3 * limits.pre_trigger_s:.0f} ms before it: neither t = 0 nor the zero of the "
            "gauges is shown.",
        )
    steps = np.diff(run.t_s)
    usual = float(np.median(steps)) if steps.size else 0.0
    if not run.stop_s >= limits.shortest_s:
        yield Flag(
            "too_short",
            f"Only {run.stop_s:.3f} s lie between the relay command and the stop, need "
            f"{limits.shortest_s} s.",
        )
    elif last < run.stop_s - limits.gap * usual:
        yield Flag(
            "too_short", f"The record ends at {last:.3f} s, before the stop at {run.stop_s:.3f} s."
        )
    elif (samples := int(np.count_nonzero(driven(run)))) < FEWEST_SAMPLES:
        yield Flag(
            "too_short",
            f"Only {samples} samples lie between the relay command and the stop, need "
            f"{FEWEST_SAMPLES}.",
        )
    if run.stop_s >= limits.watchdog_s:
        yield Flag(
            "watchdog",
            f"The drive was stopped by time, after {run.stop_s:.2f} s, not by travel: a dead "
            "potentiometer, a blocked wheel, or too little voltage.",
        )
    used = run.t_s <= run.stop_s
    before_stop = run.t_s[:-1] + limits.gap * usual <= run.stop_s
    uneven = before_stop & ((steps > limits.gap * usual) | (steps <= 0.0))
    if np.any(uneven):
        at = int(np.argmax(uneven))
        yield Flag(
            "missing_samples",
            f"The times are uneven at {np.count_nonzero(uneven)} places, first at "
            f"{run.t_s[at]:.4f} s with {1e3 * steps[at]:.3f} ms to the next sample, usual are "
            f"{1e3 * usual:.3f} ms.",
        )
    for name, volts in _volts(run).items():
        if bad := int(np.count_nonzero(~readable(volts[used]))):
            yield Flag("nan_samples", f"{bad} samples of {name} are no numbers of a card.")
        if np.count_nonzero(np.abs(volts[used]) >= limits.rail_v) >= AT_END_SAMPLES:
            yield Flag(
                "at_rail",
                f"The signal of {name} is at the limit of the converter (beyond "
                f"{limits.rail_v} V): a broken wire, or too much gain.",
            )


def _signals(run: AngleRun, calibration: AngleCalibration, limits: Limits) -> Iterator[Flag]:
    used = run.t_s <= run.stop_s
    t_s = run.t_s[used]
    noisy = [
        f"{name} {noise:.3g} V"
        for name, volts in _volts(run).items()
        if (noise := white_noise(volts[used]))
        > (limits.gauge_noise_v if "gauge" in name else limits.pot_noise_v)
    ]
    if noisy:
        yield Flag(
            "noisy",
            f"Noise of each sample: {', '.join(noisy)}; at most {limits.gauge_noise_v} V of a "
            f"gauge and {limits.pot_noise_v} V of a potentiometer are explained: a broken wire, a "
            "loose screen, an amplifier that oscillates.",
        )
        return
    for name, volts in _volts(run).items():
        if "gauge" in name:
            yield from _stuck(name, t_s[t_s > REST_S], volts[used][t_s > REST_S])
    pots = (
        _Pot("wheel", "rad", t_s, run.wheel_v[used], calibration.wheel.value,
             limits.wheel_rad, limits.wheel_room_rad),
        _Pot("platform", "m", t_s, run.platform_v[used], calibration.platform.value,
             limits.platform_m, limits.platform_room_m),
    )  # fmt: skip
    rest, early = t_s <= REST_S, (t_s > REST_S) & (t_s <= limits.early_s)
    if not np.any(rest) or not np.any(early):
        return  # begins too late, which is reported
    for pot in pots:
        before = pot.moved(float(t_s[0]), 0.0)
        if abs(before) > pot.least:
            yield Flag(
                "moving_at_start",
                f"The {pot.name} moved {before:+.3g} {pot.unit} before the relay command; it must "
                "stand still.",
            )
    rise_a, rise_b = (
        float(np.mean(volts[used][early]) - np.mean(volts[used][rest]))
        for volts in (run.gauge_a_v, run.gauge_b_v)
    )
    torque = calibration.torque.value * (rise_a - rise_b)
    before = calibration.torque.value * float(
        np.mean((run.gauge_a_v - run.gauge_b_v)[used][t_s < 0.0]) if t_s[0] < 0.0 else 0.0
    )
    if abs(before) > limits.zero_nm:
        yield Flag(
            "gauges_off_zero",
            f"The gauges show {before:+.2f} N m before the relay command, must be within "
            f"{limits.zero_nm} N m: balance their amplifier.",
        )
    standstills = [_standstill(pot, run.stop_s) for pot in pots]
    if abs(torque) < limits.torque_nm and all(standstills):
        yield Flag(
            "no_drive",
            f"Neither torque ({torque:+.3f} N m) nor movement after the relay command: relay, "
            "motor, or its supply is off.",
        )
        return
    yield from _gauges(torque, rise_a, rise_b, limits)
    # Ten turns of the wheel's potentiometer take its whole excitation, which both share.
    excitation_v = abs(2.0 * math.pi * limits.turns / calibration.wheel.value)
    for pot, standstill in zip(pots, standstills, strict=True):
        yield from _potentiometer(pot, standstill, excitation_v, limits)


def _stuck(name: str, t_s: FloatArray, volts: FloatArray) -> Iterator[Flag]:
    """Report the longest repetition of one value in a noisy signal, if chance does not explain it.

    Neighbours are equal with the share p that the signal itself shows; L of them in a row have the
    probability p^L, at any of its n places.
    """
    steps = np.diff(volts)
    equal = steps == 0.0
    apart = np.abs(steps[~equal])
    if not apart.size or white_noise(volts) < max(QUIET * float(np.min(apart)), QUIET_V):
        return  # the noise is finer than the converter: it repeats itself
    share = min(float(np.mean(equal)), 0.98)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], equal, [False]]).astype(np.int8)))
    if not edges.size:
        return
    lengths = edges[1::2] - edges[::2]
    longest = int(np.argmax(lengths))
    most = max(LEAST_STUCK, math.log(CHANCE / volts.size) / math.log(share))
    if lengths[longest] > most:
        at = int(edges[2 * longest])
        yield Flag(
            "stuck_samples",
            f"From {t_s[at]:.4f} s on {name} gives {volts[at]:z.4f} V {int(lengths[longest]) + 1} "
            f"times in a row; its noise explains {int(most) + 1}: the card or its driver repeats "
            "samples.",
        )


def _gauges(torque: float, rise_a: float, rise_b: float, limits: Limits) -> Iterator[Flag]:
    first = f"in the first {1e3 * limits.early_s:.0f} ms"
    if abs(torque) < limits.torque_nm:
        yield Flag(
            "no_torque",
            f"The wheel is driven, but the gauges show {torque:+.3f} N m {first}: their amplifier "
            "is off, or one has its leads reversed.",
        )
        return
    if torque < 0.0:
        yield Flag(
            "negative_torque",
            f"The gauges show {torque:+.2f} N m {first}, below 0: gauge a and b are swapped.",
        )
    share = rise_a / (rise_a - rise_b)
    if not limits.gauge_share <= share <= 1.0 - limits.gauge_share:
        odd, rise, other = ("a", rise_a, rise_b) if share < 0.5 else ("b", rise_b, rise_a)
        yield Flag(
            "gauges_disagree",
            f"Gauge {odd} changes by {rise:+.3f} V {first} and the other by {other:+.3f} V; they "
            "must change by about the same, one up and one down: a broken wire, or leads reversed.",
        )


def _potentiometer(
    pot: _Pot, standstill: tuple[float, float] | None, excitation_v: float, limits: Limits
) -> Iterator[Flag]:
    early = pot.moved(0.0, limits.early_s)
    if early < -pot.least:
        yield Flag(
            "negative_speed",
            f"The {pot.name} runs backwards, {early:+.3g} {pot.unit} in the first "
            f"{1e3 * limits.early_s:.0f} ms: the leads of its potentiometer are swapped.",
        )
    if standstill is not None:
        start, end = standstill
        yield Flag(
            "pot_dead",
            f"The {pot.name}'s potentiometer stands at {_level(pot.t_s, pot.volts, end):z.2f} V "
            f"from {start:.2f} s to {end:.2f} s while the gauges show torque: broken wire, slack "
            "thread, at its end, or the wheel is blocked.",
        )
    fastest, when_s = _fastest(pot)
    if fastest > limits.pot_v_per_s:
        yield Flag(
            "pot_jumps",
            f"The {pot.name}'s potentiometer jumps by {JUMP_S * fastest:.2f} V "
            f"({abs(pot.scale) * JUMP_S * fastest:.3g} {pot.unit}) at {when_s:.3f} s, faster than "
            "anything moves: its wiper lifts off, or its thread slips.",
        )
    margin = limits.end_share * excitation_v
    at_end = (pot.volts < margin) | (pot.volts > excitation_v - margin)
    if np.count_nonzero(at_end) >= AT_END_SAMPLES:
        yield Flag(
            "pot_at_end",
            f"The {pot.name}'s potentiometer is at its end at {pot.t_s[np.argmax(at_end)]:.3f} s "
            f"({pot.volts[np.argmax(at_end)]:z.2f} V of 0 to {excitation_v:.2f} V): it has "
            f"{limits.turns:g} turns and does not wrap; turn it back before a run.",
        )
        return
    start_v = _level(pot.t_s, pot.volts, 0.0)
    room = abs(pot.scale) * (excitation_v - start_v if pot.scale > 0.0 else start_v)
    if room < pot.room:
        yield Flag(
            "pot_near_end",
            f"The {pot.name}'s potentiometer started at {start_v:.2f} V, {room:.3g} {pot.unit} "
            f"before its end; a run may need {pot.room:.3g} {pot.unit}.",
            Severity.NOTE,
        )


def _standstill(pot: _Pot, stop_s: float) -> tuple[float, float] | None:
    """Return the first eighth of the run, from the third on, in which ``pot`` does not move."""
    for k in range(2, 8):
        start, end = 0.125 * k * stop_s, 0.125 * (k + 1) * stop_s
        if abs(pot.moved(start, end)) < pot.least:
            return start, end
    return None


def _fastest(pot: _Pot) -> tuple[float, float]:
    """Return the largest speed of ``pot`` in V/s between medians over 2.5 ms, and its time."""
    period_s = float(pot.t_s[-1] - pot.t_s[0]) / (pot.t_s.size - 1)
    size = max(round(JUMP_S / period_s), 1)
    blocks = pot.t_s.size // size
    levels = np.median(pot.volts[: blocks * size].reshape(blocks, size), axis=1)
    steps = np.abs(np.diff(levels))
    at = int(np.argmax(steps))
    return float(steps[at]) / (size * period_s), float(pot.t_s[(at + 1) * size])


def _level(t_s: FloatArray, volts: FloatArray, at_s: float) -> float:
    """Return the mean of ``volts`` within 2.5 ms of ``at_s``."""
    first, last = np.searchsorted(t_s, [at_s - 0.0025, at_s + 0.0025])
    return float(np.mean(volts[min(first, t_s.size - 1) : max(last, first + 1)]))
