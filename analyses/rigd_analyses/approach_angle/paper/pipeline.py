"""Evaluates one run of the wheel by all steps of the paper's method, in the order of the paper.

The paper is "Omni-wheel friction coefficient measuring methodology for various angles". A run is
one recorded movement: the motor turns the wheel, and the wheel drives the platform along its rails.

Input: the raw volts of both strain gauges and of the potentiometers of wheel and platform, over the
time since the relay command that starts the motor; the load that the scale showed; the calibration;
the data of the rig; the settings of the method.

Steps and output (:class:`PaperRun`):

1. A Fourier series smooths the gauges' volts, which give the torque of the shaft (Eq. 4 to 8).
2. A Gaussian is fitted to the torque peak at the start. p is the time of the largest torque. sigma
   is the standard deviation of the Gaussian, in s (Eq. 9). The steady segment is the part of the
   record after p + 2 sigma.
3. T is the mean torque of the steady segment, R the nominal radius of the wheel, and N the normal
   force (the load) of the wheel, from the scale. T/(R N) is what the paper calls the friction
   coefficient.
4. The positions are smoothed, differentiated and smoothed again (Eq. 10). The speeds give the slip
   (Eq. 11 and 12), and whether the wheel slid, rolled, or did both.

The checks of the raw data (:func:`~rigd_analyses.approach_angle.raw.flags.raw_flags`) come first.
If they exclude the run, the module adds no flag but too_slow. (A run with negative torque, for
example, has no peak either; a second flag for the missing peak would only confuse.) The module's
own flags are:

===============  ========  =====================================================================
code             severity  found when
===============  ========  =====================================================================
peak_at_edge     excluded  the torque is largest at an end of the record: noise at the edge of
                           the Fourier curve, or no breakaway peak; sigma has no meaning then
steady_short     excluded  less than a tenth of the record is after p + 2 sigma
too_slow         excluded  the sampling is too slow, or the samples too few, for the smoothing
no_speed         excluded  the platform's speed is nowhere above 0 in the steady segment
no_sliding       note      the wheel rolled: T/(R N) is the force that this motion needed, not the
                           limit of the friction
partly_sliding   note      the wheel slid for a part of the segment: T/(R N) may be a mean over
                           rolling and sliding
===============  ========  =====================================================================

An excluded run keeps its curves, if they could be computed, so that a report can show the fault. It
keeps none of its numbers. A note leaves the numbers as they are.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rigd_analyses.approach_angle.paper.fourier import fit_fourier
from rigd_analyses.approach_angle.paper.gauss import Peak, fit_peak
from rigd_analyses.approach_angle.paper.result import PaperCurves, PaperRun
from rigd_analyses.approach_angle.paper.settings import PaperSettings
from rigd_analyses.approach_angle.paper.slip import mean_slip
from rigd_analyses.approach_angle.paper.smoothing import central_difference, smooth
from rigd_analyses.approach_angle.paper.strain import torque_nm
from rigd_analyses.approach_angle.raw.flags import driven, raw_flags, whole
from rigd_analyses.approach_angle.raw.run_data import (
    AngleCalibration,
    AngleRig,
    AngleRun,
    Flag,
    FloatArray,
    Regime,
    Severity,
)
from rigd_analyses.approach_angle.regime import SLIDING_SLIP, regime_of

NAN = float("nan")


def analyse_paper(
    run: AngleRun,
    calibration: AngleCalibration,
    rig: AngleRig,
    settings: PaperSettings | None = None,
) -> PaperRun:
    """Return what the paper's method makes of ``run``; never raises for a bad one.

    It works on the samples from the relay command to the stop. R is the nominal radius of the
    wheel; inertia, bearings, and rolling resistance are left out and N is the scale's one reading,
    as in the paper, which makes mu 5 to 17 % too large.
    """
    settings = PaperSettings() if settings is None else settings
    flags = raw_flags(run, calibration, rig, settings.limits)
    if not whole(run):
        return _nothing(flags)
    slow = tuple(_too_slow(run.t_s[driven(run)], settings))
    if slow:
        return _nothing(flags + slow)

    curves, peak = _curves(run, calibration, rig, settings)
    if _excluded(flags):
        return _nothing(flags, curves)
    t_steady_s = peak.time_s + settings.steady_sigmas * peak.sigma_s
    moving = (curves.speed_t_s >= t_steady_s) & (curves.platform_speed_m_s > 0.0)
    flags += tuple(_peak_flags(curves, peak, t_steady_s, settings))
    if not _excluded(flags) and not np.any(moving):
        flags += (Flag("no_speed", "The platform never moves forwards in the steady segment."),)
    if _excluded(flags):
        return _nothing(flags, curves)

    rim, platform = curves.rim_speed_m_s[moving], curves.platform_speed_m_s[moving]
    slip = mean_slip(rim, platform, run.alpha_rad)
    regime = regime_of(rim / (platform * np.cos(run.alpha_rad)) - 1.0)
    mean_nm = float(np.mean(curves.torque_nm[curves.t_s >= t_steady_s]))
    return PaperRun(
        torque_nm=mean_nm,
        mu=mean_nm / (rig.wheel_radius_m * calibration.load.value * run.load_n),
        slip=slip.paper,
        slip_corrected=slip.corrected,
        relative_speed=slip.relative_speed_m_s,
        sigma_s=peak.sigma_s,
        h=peak.height_nm,
        p=peak.time_s,
        t_steady_s=t_steady_s,
        regime=regime,
        flags=flags + tuple(_regime_flags(regime, slip.corrected)),
        curves=curves,
    )


def _curves(
    run: AngleRun, calibration: AngleCalibration, rig: AngleRig, settings: PaperSettings
) -> tuple[PaperCurves, Peak]:
    used = driven(run)
    t_s, gauge_a, gauge_b = run.t_s[used], run.gauge_a_v[used], run.gauge_b_v[used]
    fit = fit_fourier(
        t_s, np.stack([gauge_a, gauge_b], axis=1),
        highest_hz=settings.highest_hz, rcond=settings.rcond,
    )  # fmt: skip
    fourier_a, fourier_b = fit.curves.T
    torque = torque_nm(fourier_a, fourier_b, calibration.torque.value)
    peak = fit_peak(t_s, torque, settings.fit_window)

    raw = np.stack(
        [
            calibration.platform.value * run.platform_v[used],
            rig.wheel_radius_m * calibration.wheel.value * run.wheel_v[used],
        ]
    )
    rate_hz, half = _rate_hz(t_s), settings.lost // 2
    positions, position_t_s = smooth(raw, rate_hz, settings), t_s[half : t_s.size - half]
    speeds = smooth(central_difference(position_t_s, positions), rate_hz, settings)
    curves = PaperCurves(
        t_s=t_s,
        gauge_a_v=gauge_a,
        gauge_b_v=gauge_b,
        fourier_a_v=fourier_a,
        fourier_b_v=fourier_b,
        torque_nm=torque,
        gaussian_t_s=t_s[peak.window],
        gaussian_nm=peak.at(t_s[peak.window]),
        platform_raw_m=raw[0],
        rim_raw_m=raw[1],
        position_t_s=position_t_s,
        platform_m=positions[0],
        rim_m=positions[1],
        speed_t_s=position_t_s[half + 1 : position_t_s.size - half - 1],
        platform_speed_m_s=speeds[0],
        rim_speed_m_s=speeds[1],
    )
    return curves, peak


def _rate_hz(t_s: FloatArray) -> float:
    return float((t_s.size - 1) / (t_s[-1] - t_s[0]))


def _too_slow(t_s: FloatArray, settings: PaperSettings) -> Iterator[Flag]:
    least, least_hz = 2 * settings.lost + 4, 2.0 * max(settings.cutoffs_hz)
    if t_s.size < least or _rate_hz(t_s) <= least_hz:
        yield Flag(
            "too_slow",
            f"{t_s.size} samples at {_rate_hz(t_s):.0f} Hz; the smoothing needs {least}, and more "
            f"than {least_hz:.0f} Hz.",
        )


def _peak_flags(
    curves: PaperCurves, peak: Peak, t_steady_s: float, settings: PaperSettings
) -> Iterator[Flag]:
    start, end = float(curves.t_s[0]), float(curves.t_s[-1])
    nearest = min(peak.time_s - start, end - peak.time_s)
    if nearest < settings.peak_free_s:
        yield Flag(
            "peak_at_edge",
            f"The torque is largest at {peak.time_s:.3f} s, at the edge of the record ({start:.3f} "
            f"s to {end:.3f} s), where the Fourier curve is least certain: no peak to separate.",
        )
    steady = (end - t_steady_s) / (end - start)
    if steady < settings.steady_share:
        yield Flag(
            "steady_short",
            f"The peak (at {peak.time_s:.3f} s, sigma {1e3 * peak.sigma_s:.0f} ms) leaves "
            f"{100 * max(steady, 0.0):.0f} % of the record as steady segment, need "
            f"{100 * settings.steady_share:.0f} %.",
        )


def _regime_flags(regime: Regime, slip: float) -> Iterator[Flag]:
    if regime is Regime.ROLLING:
        yield Flag(
            "no_sliding",
            f"The wheel rolled (corrected slip {slip:.2f}, sliding begins at {SLIDING_SLIP}): "
            "T/(R N) is the force that the motion demands, not a friction coefficient.",
            Severity.NOTE,
        )
    elif regime is Regime.MIXED:
        yield Flag(
            "partly_sliding",
            f"The wheel slid for a part of the steady segment only (mean corrected slip "
            f"{slip:.2f}): T/(R N) may lie below the friction limit.",
            Severity.NOTE,
        )


def _excluded(flags: tuple[Flag, ...]) -> bool:
    return any(flag.severity is Severity.EXCLUDED for flag in flags)


def _nothing(flags: tuple[Flag, ...], curves: PaperCurves | None = None) -> PaperRun:
    return PaperRun(NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN, None, flags, curves)
