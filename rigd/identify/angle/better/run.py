"""The better analysis of one run: friction where the wheel slides, demand where it rolls."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rigd.identify.angle.better.bending import Bending
from rigd.identify.angle.better.forces import demanded_force, rolling_force
from rigd.identify.angle.better.motion import Means, Motion, motion
from rigd.identify.angle.better.result import BetterRun, Blocks, BoolArray
from rigd.identify.angle.better.settings import BetterSettings
from rigd.identify.angle.budget import Budget, Conditions, Sizes, budget
from rigd.identify.angle.data import (
    AngleCalibration,
    AngleRig,
    AngleRun,
    Flag,
    FloatArray,
    Regime,
    Severity,
)
from rigd.identify.angle.flags import raw_flags, whole
from rigd.identify.angle.regime import SLIDING_SLIP, regime_of

NAN = float("nan")


def analyse_better(
    run: AngleRun,
    calibration: AngleCalibration,
    rig: AngleRig,
    settings: BetterSettings | None = None,
    bending: Bending | None = None,
) -> BetterRun:
    """Return friction, slip and the force balance of ``run``; never raises for a bad run.

    ``bending`` is the crosstalk learnt from the whole campaign. Only with it the zero before the
    trigger is taken off: without, that zero holds the crosstalk at the start's angle, and taking
    it off adds as much as it removes.
    """
    settings = BetterSettings() if settings is None else settings
    flags = raw_flags(run, calibration, rig, settings.limits)
    if not usable(run, flags):
        return no_numbers(flags)
    return evaluate(motion(run, calibration, rig, settings), calibration, rig, settings,
                    flags=flags, bending=bending)  # fmt: skip


def usable(run: AngleRun, flags: tuple[Flag, ...]) -> bool:
    """Return whether numbers may be computed from a run with these flags."""
    return whole(run) and all(f.severity is not Severity.EXCLUDED for f in flags)


def no_numbers(flags: tuple[Flag, ...]) -> BetterRun:
    """Return the result of a run of which no number can be defended; ``flags`` say why."""
    return BetterRun(
        mu=NAN, mu_u=NAN, demand=NAN, torque_nm=NAN, normal_force_n=NAN, sliding_speed_m_s=NAN,
        slip=NAN, slip_corrected=NAN, slip_corrected_u=NAN, relative_speed_m_s=NAN, regime=None,
        blocks=Blocks.none(), force_residual=NAN, force_residual_limit=NAN, tare_v=NAN, flags=flags,
    )  # fmt: skip


def sliding_blocks(motion: Motion, rig: AngleRig, settings: BetterSettings) -> BoolArray:
    """Return in which blocks all of the contact slides steadily, (n,); see BetterSettings."""
    means = motion.means
    along = means.platform_speed_m_s * math.cos(motion.run.alpha_rad)
    return np.asarray(
        (means.sliding_speed_m_s >= np.maximum(settings.sliding_speed_m_s, SLIDING_SLIP * along))
        & (means.slid_m >= settings.sliding_distance_m)
    )


def torque_at_gauges(
    motion: Motion, calibration: AngleCalibration, bending: Bending | None
) -> FloatArray:
    """Return the torque in N m of each block, less zero and crosstalk where both are known."""
    torque = calibration.torque.value * motion.means.gauges_v
    if bending is None:
        return torque
    crosstalk = bending.torque(motion.means.turn, motion.means.normal_force_n)
    if not math.isfinite(motion.tare_v):
        return np.asarray(torque - crosstalk)
    start = bending.torque(motion.start_turn, motion.start_normal_n)
    return np.asarray(torque - crosstalk - (calibration.torque.value * motion.tare_v - start))


def evaluate(
    motion: Motion,
    calibration: AngleCalibration,
    rig: AngleRig,
    settings: BetterSettings,
    *,
    flags: tuple[Flag, ...] = (),
    bending: Bending | None = None,
) -> BetterRun:
    """Return the result of a run whose speeds are known already; ``flags`` are handed on."""
    means, alpha = motion.means, motion.run.alpha_rad
    torque = torque_at_gauges(motion, calibration, bending)
    force = rolling_force(torque, means, rig)
    normal = means.normal_force_n
    sliding = sliding_blocks(motion, rig, settings)
    slides = int(np.count_nonzero(sliding)) >= settings.min_sliding_blocks
    used = sliding if slides else np.ones_like(sliding)
    share = float(np.sum(force[used]) / np.sum(normal[used]))
    residual, limit = _balance(force, means, rig, alpha, settings)
    terms = _uncertainty(motion, torque, share, used, calibration, rig, settings, bending)
    slip = _slip(motion, calibration, rig, settings)
    found = [*flags, *_flags(sliding, residual, limit, slip, settings)]
    return BetterRun(
        mu=share if slides else NAN,
        mu_u=abs(share) * terms.measurement if slides else NAN,
        demand=float(np.sum(force) / np.sum(normal)),
        torque_nm=float(np.mean(torque[used])),
        normal_force_n=float(np.mean(normal[used])),
        sliding_speed_m_s=float(np.mean(means.sliding_speed_m_s[used])),
        slip=slip.paper,
        slip_corrected=slip.corrected,
        slip_corrected_u=slip.corrected_u,
        relative_speed_m_s=slip.relative_speed_m_s,
        regime=slip.regime,
        blocks=Blocks(means.t_s, means.sliding_speed_m_s, force / normal, normal, sliding),
        force_residual=residual,
        force_residual_limit=limit,
        tare_v=motion.tare_v,
        flags=tuple(found),
        curves=motion.smoothed,
        budget=terms if slides else None,
    )


def _balance(
    force: FloatArray, means: Means, rig: AngleRig, alpha: float, settings: BetterSettings
) -> tuple[float, float]:
    """Return residual and limit of the force balance, relative to N, over all steady blocks.

    Torque that is lost between gauges and wheel (bad clamping) shows as a force which does not
    move the platform.
    """
    normal = float(np.mean(means.normal_force_n))
    excess = float(np.mean(force - demanded_force(force, means, rig, alpha))) / normal
    share = abs(float(np.mean(force))) / normal
    return abs(excess), settings.balance_constant + settings.balance_share * share


@dataclass(frozen=True)
class _Slip:
    paper: float
    corrected: float
    corrected_u: float
    relative_speed_m_s: float
    regime: Regime


def _slip(
    motion: Motion, calibration: AngleCalibration, rig: AngleRig, settings: BetterSettings
) -> _Slip:
    """Return both slips as ratios of means over the steady part, and the regime there."""
    rim = rig.wheel_radius_m * motion.wheel_speed_rad_s
    rolling = rig.effective_radius.value * rim
    along = motion.platform_speed_m_s * math.cos(motion.run.alpha_rad)
    moving = along > settings.sliding_speed_m_s
    if not np.any(moving):
        return _Slip(NAN, NAN, NAN, float(np.mean(rim - motion.platform_speed_m_s)), Regime.SLIDING)
    rim, rolling, along = rim[moving], rolling[moving], along[moving]
    speed = motion.platform_speed_m_s[moving]
    ratio = float(np.mean(rolling) / np.mean(along))
    # Neighbouring samples of a smoothed speed repeat each other over half a period of its cut-off.
    seconds = float(np.count_nonzero(moving)) * float(np.median(np.diff(motion.steady_t_s)))
    independent = max(1.0, 2.0 * settings.wheel_cutoff_hz * seconds)
    parts = (
        rig.effective_radius.u / rig.effective_radius.value,
        calibration.wheel.u / calibration.wheel.value,
        calibration.platform.u / calibration.platform.value,
        settings.angle_u_rad * math.tan(motion.run.alpha_rad),
        motion.speed_u_m_s / (float(np.mean(speed)) * math.sqrt(independent)),
        motion.speed_u_m_s / (float(np.mean(rim)) * math.sqrt(independent)),
    )
    return _Slip(
        paper=float(np.mean(rim) / np.mean(speed) - 1.0),
        corrected=ratio - 1.0,
        corrected_u=ratio * math.hypot(*parts),
        relative_speed_m_s=float(np.mean(rim - speed)),
        regime=regime_of(rolling / along - 1.0),
    )


def _flags(
    sliding: BoolArray, residual: float, limit: float, slip: _Slip, settings: BetterSettings
) -> Iterator[Flag]:
    count = int(np.count_nonzero(sliding))
    if count < settings.min_sliding_blocks:
        yield Flag(
            "no_sliding",
            f"The wheel slides in {count} of {sliding.size} blocks of "
            f"{1e3 * settings.block_s:.0f} ms, need {settings.min_sliding_blocks}: F_r/N is what "
            "the motion asked for, not a limit of friction.",
            Severity.NOTE,
        )
    if residual > limit:
        yield Flag(
            "rubbing",
            f"The gauges show {residual:.3f} N per N of load more or less than the platform's "
            f"motion and the rails need, at most {limit:.3f} is explained: torque is lost between "
            "gauges and wheel (bad clamping), or a calibration is wrong.",
        )


def _uncertainty(
    motion: Motion,
    torque: FloatArray,
    mu: float,
    used: BoolArray,
    calibration: AngleCalibration,
    rig: AngleRig,
    settings: BetterSettings,
    bending: Bending | None,
) -> Budget:
    """Return the budget of this run's F_r/N."""
    means, scale = motion.means, calibration.torque.value
    speed = float(np.mean(means.wheel_speed_rad_s[used]))
    seconds = settings.block_s * float(np.count_nonzero(used))
    learnt = bending is not None and math.isfinite(bending.zero_u_nm)
    at = Conditions(
        mu=abs(mu),
        torque_nm=float(np.mean(torque[used])),
        normal_force_n=float(np.mean(means.normal_force_n[used])),
        wheel_speed_rad_s=speed,
        wheel_acceleration_rad_s2=float(np.mean(means.wheel_acceleration_rad_s2[used])),
        travel_m=float(np.mean(means.platform_travel_m[used])),
        turns=abs(speed) * seconds / (2.0 * math.pi),
        samples=round(seconds / motion.period_s),
    )
    sizes = Sizes(
        zero_nm=bending.zero_u_nm if bending and learnt else abs(scale) * settings.zero_u_v,
        tare_nm=abs(scale) * motion.tare_u_v,
        tared=bending is not None and math.isfinite(motion.tare_v),
        noise_nm=abs(scale) * motion.noise_v,
        crosstalk=settings.crosstalk_m if bending is None else bending.amplitude,
        crosstalk_u=settings.crosstalk_m if bending is None else bending.u,
        scatter=settings.scatter_u,
        scatter_kind="B",
        inertia=settings.inertia_u,
        load_reading_n=settings.load_reading_u_n,
        load_change=settings.load_change_u,
        load_cell=motion.run.normal_force_v is not None and calibration.normal_force is not None,
        vibration=settings.vibration_u,
    )
    return budget(at, calibration, rig, sizes)
