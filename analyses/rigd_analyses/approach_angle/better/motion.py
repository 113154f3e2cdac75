"""Computes wheel and platform speeds, and means over short blocks, from the raw volts of one run.

A run is one recorded movement of the platform, which the wheel drives. The module

- smooths the wheel's angle and the platform's position, and computes speeds and accelerations;
- averages the speeds, the gauges' volts and the normal force over consecutive blocks
  (:class:`Means`). A block is as long as one period of the mains (20 ms), so that the hum of the
  mains cancels;
- determines the noise of the gauges, and their zero (the tare) from the samples before the relay
  command that starts the motor.

The friction is computed from these values elsewhere, by the corrected method (the one that corrects
what the paper's method leaves out).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rigd_analyses.approach_angle.better.result import Smoothed
from rigd_analyses.approach_angle.better.settings import BetterSettings
from rigd_analyses.approach_angle.better.smoother import Track, smooth
from rigd_analyses.approach_angle.raw.flags import REST_S
from rigd_analyses.approach_angle.raw.run_data import AngleRun, FloatArray, KnownRun
from rigd_analyses.approach_angle.raw.samples import readable

#: Times further apart than this, of the usual, are a gap.
GAP = 1.5


@dataclass(frozen=True, eq=False)
class Means:
    """Means over consecutive blocks of the driven part of a run, (n,) each; n may be 0.

    ``turn`` (n, 2) are the means of cos and sin of the wheel's angle as its potentiometer shows
    it, which the shaft's bending follows.
    """

    t_s: FloatArray
    gauges_v: FloatArray  #: gauge a - gauge b
    normal_force_n: FloatArray
    wheel_speed_rad_s: FloatArray
    wheel_acceleration_rad_s2: FloatArray
    platform_travel_m: FloatArray  #: since the start
    platform_speed_m_s: FloatArray
    platform_acceleration_m_s2: FloatArray
    sliding_speed_m_s: FloatArray  #: R_eff w - V cos(alpha)
    slid_m: FloatArray  #: the contact since the start, when the block begins
    turn: FloatArray


@dataclass(frozen=True, eq=False)
class Motion:
    """One run with its speeds; nothing in it depends on how the zero of the gauges is determined.

    ``tare_v`` is the mean of (gauge a - gauge b) before the trigger and ``tare_u_v`` its standard
    uncertainty from the noise; NaN with less than ``min_tare_s`` of it. ``start_turn`` (2,) is the
    mean of cos and sin of the wheel's angle then, ``start_normal_n`` the normal force.
    """

    known: KnownRun
    period_s: float  #: between samples
    means: Means
    steady_t_s: FloatArray  #: the smoothed samples of the steady part, (m,)
    wheel_speed_rad_s: FloatArray  #: at ``steady_t_s``
    platform_speed_m_s: FloatArray
    speed_u_m_s: float  #: of one smoothed speed, rim or platform, the larger
    tare_v: float
    tare_u_v: float
    noise_v: float  #: standard deviation of one sample of (gauge a - gauge b)
    start_turn: FloatArray
    start_normal_n: float
    smoothed: Smoothed


def motion(known: KnownRun, settings: BetterSettings) -> Motion:
    """Return speeds and block means of a run whose signals are whole.

    Samples before the trigger and after the stop are used if there are any, so that the ends
    of the smoother lie outside of the driven part.
    """
    known = replace(known, run=_readable(known.run))
    run, calibration = known.run, known.calibration
    period = float(run.t_s[-1] - run.t_s[0]) / (run.t_s.size - 1)
    factor = max(1, round(1.0 / (period * settings.smoothed_hz)))
    t = _decimated(run.t_s, factor)
    wheel = smooth(
        calibration.wheel.value * _decimated(run.wheel_v, factor),
        factor * period,
        settings.wheel_cutoff_hz,
    )
    platform = smooth(
        calibration.platform.value * _decimated(run.platform_v, factor),
        factor * period,
        settings.platform_cutoff_hz,
    )
    gauges = run.gauge_a_v - run.gauge_b_v
    noise = float(np.std(np.diff(gauges))) / np.sqrt(2.0)
    tare, tare_u = _tare(run, gauges, period, noise, settings)
    travel = np.interp(run.t_s, t, platform.position - platform.position[0])
    normal = normal_force(known, travel)
    steady = (t >= settings.start_s) & (t <= run.stop_s)
    return Motion(
        known=known,
        period_s=period,
        means=_means(known, gauges, normal, t, wheel, platform, settings),
        steady_t_s=t[steady],
        wheel_speed_rad_s=wheel.speed[steady],
        platform_speed_m_s=platform.speed[steady],
        speed_u_m_s=max(
            float(np.median(platform.speed_u)),
            known.rig.wheel_radius_m * float(np.median(wheel.speed_u)),
        ),
        tare_v=tare,
        tare_u_v=tare_u,
        noise_v=noise,
        start_turn=_turn(wheel.position[: max(1, int(np.searchsorted(t, 0.0)))]).mean(axis=0),
        start_normal_n=float(np.mean(normal[: max(1, int(np.searchsorted(run.t_s, 0.0)))])),
        smoothed=Smoothed(
            t_s=t,
            torque_nm=calibration.torque.value * _decimated(gauges, factor),
            wheel_angle_rad=wheel.position,
            wheel_speed_rad_s=wheel.speed,
            wheel_acceleration_rad_s2=wheel.acceleration,
            platform_position_m=platform.position,
            platform_speed_m_s=platform.speed,
            platform_acceleration_m_s2=platform.acceleration,
        ),
    )


def _readable(run: AngleRun) -> AngleRun:
    """Return ``run`` up to the first fault after the stop: no number, or a gap; all without one.

    What lies behind the stop only helps the smoother, so its faults do not exclude the run.
    """
    signals = [run.gauge_a_v, run.gauge_b_v, run.wheel_v, run.platform_v]
    steps = np.diff(run.t_s, prepend=run.t_s[0])
    even = (steps >= 0.0) & (steps < GAP * float(np.median(steps)))
    bad = np.any([~even, *(~readable(s) for s in signals)], axis=0) & (run.t_s > run.stop_s)
    if not np.any(bad):
        return run
    end = int(np.argmax(bad))
    cell = run.normal_force_v
    return replace(
        run, t_s=run.t_s[:end], gauge_a_v=run.gauge_a_v[:end], gauge_b_v=run.gauge_b_v[:end],
        wheel_v=run.wheel_v[:end], platform_v=run.platform_v[:end],
        normal_force_v=None if cell is None else cell[:end],
    )  # fmt: skip


def normal_force(known: KnownRun, travel_m: FloatArray) -> FloatArray:
    """Return N in newtons at each sample, (n,), where the platform has gone ``travel_m`` (n,).

    By the scale's reading before the start, and from there on by the high-rate load cell, whose own
    zero drops out: it is known to some newtons only. Without a load cell, by the scale and the
    known rise along the travel.
    """
    run, calibration = known.run, known.calibration
    if run.normal_force_v is not None and calibration.normal_force is not None:
        before = run.normal_force_v[run.t_s <= REST_S]
        scale = calibration.normal_force.value
        if before.size and math.isfinite(run.load_n):
            start_n, zero_v = calibration.load.value * run.load_n, float(np.mean(before))
        else:
            start_n, zero_v = 0.0, calibration.normal_force_zero.value
        return np.asarray(start_n + scale * (run.normal_force_v - zero_v), dtype=np.float64)
    rise = 1.0 + known.rig.load_rise.value * travel_m
    return np.asarray(calibration.load.value * run.load_n * rise, dtype=np.float64)


def _decimated(values: FloatArray, factor: int) -> FloatArray:
    """Return means of ``factor`` samples each; what is left over at the end is dropped."""
    whole = values.size // factor * factor
    return np.asarray(values[:whole].reshape(-1, factor).mean(axis=1), dtype=np.float64)


def _turn(angle: FloatArray) -> FloatArray:
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _tare(
    run: AngleRun, gauges: FloatArray, period: float, noise: float, settings: BetterSettings
) -> tuple[float, float]:
    """Return zero and standard uncertainty in V, over whole periods of the mains before t = 0."""
    before = gauges[run.t_s < 0.0]
    mains = round(settings.block_s / period)
    count = before.size // mains * mains
    if count * period < settings.min_tare_s - 0.5 * period:
        return float("nan"), float("nan")
    return float(np.mean(before[-count:])), noise / float(np.sqrt(count))


def _means(
    known: KnownRun,
    gauges: FloatArray,
    normal: FloatArray,
    t: FloatArray,
    wheel: Track,
    platform: Track,
    settings: BetterSettings,
) -> Means:
    """Return the block means; blocks begin at ``start_s``, the last ends before the stop."""
    run, rig = known.run, known.rig
    count = max(int((run.stop_s - settings.start_s) / settings.block_s), 0)
    edges = settings.start_s + settings.block_s * np.arange(count + 1)
    raw, fine = np.searchsorted(run.t_s, edges), np.searchsorted(t, edges)

    def mean(values: FloatArray, at: np.ndarray[tuple[int], np.dtype[np.intp]]) -> FloatArray:
        total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
        size = np.diff(at).reshape((-1,) + (1,) * (values.ndim - 1))
        return np.asarray((total[at[1:]] - total[at[:-1]]) / size, dtype=np.float64)

    radius = rig.effective_radius.value * rig.wheel_radius_m
    speed = radius * wheel.speed - platform.speed * np.cos(run.alpha_rad)
    slid = np.cumsum(np.where(t > 0.0, speed, 0.0)) * float(t[1] - t[0])
    return Means(
        t_s=0.5 * (edges[1:] + edges[:-1]),
        gauges_v=mean(gauges, raw),
        normal_force_n=mean(normal, raw),
        wheel_speed_rad_s=mean(wheel.speed, fine),
        wheel_acceleration_rad_s2=mean(wheel.acceleration, fine),
        platform_travel_m=mean(platform.position - platform.position[0], fine),
        platform_speed_m_s=mean(platform.speed, fine),
        platform_acceleration_m_s2=mean(platform.acceleration, fine),
        sliding_speed_m_s=mean(speed, fine),
        slid_m=slid[fine[:-1]],
        turn=mean(_turn(wheel.position), fine),
    )
