"""Evaluates one run by the corrected method: friction if the wheel slides, demand if it rolls.

The demand is the force that the motion of the platform needs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from rigd_analyses.approach_angle.better.balance import Balance, force_balance
from rigd_analyses.approach_angle.better.bending import Bending
from rigd_analyses.approach_angle.better.forces import rolling_force
from rigd_analyses.approach_angle.better.hop import MOST_SHARE, UNLOADED, unloaded_share
from rigd_analyses.approach_angle.better.motion import Motion
from rigd_analyses.approach_angle.better.result import BetterRun, Blocks, BoolArray
from rigd_analyses.approach_angle.better.settings import BetterSettings
from rigd_analyses.approach_angle.better.slip import mean_slip
from rigd_analyses.approach_angle.budget import Budget, Conditions, Sizes, budget
from rigd_analyses.approach_angle.raw.flags import whole
from rigd_analyses.approach_angle.raw.run_data import AngleRun, Flag, FloatArray, Severity
from rigd_analyses.approach_angle.regime import SLIDING_SLIP

NAN = float("nan")


def usable(run: AngleRun, flags: tuple[Flag, ...]) -> bool:
    """Return whether numbers may be computed from a run with these flags."""
    return whole(run) and all(f.severity is not Severity.EXCLUDED for f in flags)


def no_numbers(flags: tuple[Flag, ...]) -> BetterRun:
    """Return the result of a run of which no number can be defended; ``flags`` give the reasons."""
    return BetterRun(
        mu=NAN, mu_u=NAN, demand=NAN, torque_nm=NAN, normal_force_n=NAN, sliding_speed_m_s=NAN,
        slip=NAN, slip_corrected=NAN, slip_corrected_u=NAN, relative_speed_m_s=NAN, regime=None,
        blocks=Blocks.none(), force_residual=NAN, force_residual_limit=NAN, tare_v=NAN, flags=flags,
    )  # fmt: skip


def sliding_blocks(motion: Motion, settings: BetterSettings) -> BoolArray:
    """Return in which blocks all of the contact slides steadily, (n,); see BetterSettings."""
    means = motion.means
    along = means.platform_speed_m_s * math.cos(motion.known.run.alpha_rad)
    return np.asarray(
        (means.sliding_speed_m_s >= np.maximum(settings.sliding_speed_m_s, SLIDING_SLIP * along))
        & (means.slid_m >= settings.sliding_distance_m)
    )


def torque_at_gauges(motion: Motion, bending: Bending | None) -> FloatArray:
    """Return the torque in N m of each block, less zero and crosstalk if both are known."""
    scale = motion.known.calibration.torque.value
    torque = scale * motion.means.gauges_v
    if bending is None:
        return torque
    crosstalk = bending.torque(motion.means.turn, motion.means.normal_force_n)
    if not math.isfinite(motion.tare_v):
        return np.asarray(torque - crosstalk)
    start = bending.torque(motion.start_turn, motion.start_normal_n)
    return np.asarray(torque - crosstalk - (scale * motion.tare_v - start))


def evaluate(
    motion: Motion,
    settings: BetterSettings,
    *,
    flags: tuple[Flag, ...] = (),
    bending: Bending | None = None,
) -> BetterRun:
    """Return the result of a run whose speeds are known already; ``flags`` are handed on.

    ``bending`` is the crosstalk learnt from the whole campaign. Only with it the zero before the
    trigger is taken off: without, that zero holds the crosstalk at the start's angle, and taking
    it off adds as much as it removes.

    A run that the force balance excludes keeps its residual and its slip, and no coefficient.
    """
    if motion.means.t_s.size == 0:
        return no_numbers(flags)
    means, normal, rig = motion.means, motion.means.normal_force_n, motion.known.rig
    torque = torque_at_gauges(motion, bending)
    force = rolling_force(torque, means, rig)
    sliding = sliding_blocks(motion, settings)
    slides = int(np.count_nonzero(sliding)) >= settings.min_sliding_blocks
    used = sliding if slides else np.ones_like(sliding)
    share = float(np.sum(force[used]) / np.sum(normal[used]))
    everywhere = _budget(motion, torque, force, np.ones_like(sliding), settings, bending)
    balance = force_balance(torque, force, motion, everywhere, settings)
    rubs = abs(balance.residual) > balance.limit
    terms = None
    if slides and not rubs:
        terms = _budget(motion, torque, force, used, settings, bending)
    slip = mean_slip(motion, settings)
    hop = unloaded_share(motion, sliding, settings.block_s) if slides else 0.0
    found = [*flags, *_flags(sliding, balance, hop, settings)]
    return BetterRun(
        mu=NAN if terms is None else share,
        mu_u=NAN if terms is None else abs(share) * terms.measurement,
        demand=NAN if rubs else float(np.sum(force) / np.sum(normal)),
        torque_nm=float(np.mean(torque[used])),
        normal_force_n=float(np.mean(normal[used])),
        sliding_speed_m_s=float(np.mean(means.sliding_speed_m_s[used])),
        slip=slip.paper,
        slip_corrected=slip.corrected,
        slip_corrected_u=slip.corrected_u,
        relative_speed_m_s=slip.relative_speed_m_s,
        regime=slip.regime,
        blocks=Blocks(
            means.t_s,
            means.sliding_speed_m_s,
            force / normal,
            normal,
            means.platform_travel_m,
            sliding,
        ),
        force_residual=balance.residual,
        force_residual_limit=balance.limit,
        balance=balance.row,
        tare_v=motion.tare_v,
        flags=tuple(found),
        curves=motion.smoothed,
        budget=terms,
    )


def _flags(
    sliding: BoolArray, balance: Balance, hop: float, settings: BetterSettings
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
    if hop > MOST_SHARE:
        yield Flag(
            "wheel_hop",
            f"In {hop:.0%} of the time in which the wheel slides the torque falls below "
            f"{UNLOADED:.0%} of its mean: the wheel hops, and its contact is unloaded. F_r/N is a "
            "mean over contact and air.",
            Severity.NOTE,
        )
    at_most = f"at most {balance.limit:.3f} is explained"
    if balance.residual > balance.limit:
        yield Flag(
            "rubbing",
            f"The gauges show {balance.residual:.3f} N per N of load more than the platform's "
            f"motion and the rails need, {at_most}: torque is lost between gauges and wheel (bad "
            "clamping), the gain or zero of a gauge is off, the angle or the platform's scale is "
            "another one, or a calibration is wrong.",
        )
    if -balance.residual > balance.limit:
        yield Flag(
            "torque_missing",
            f"The gauges show {-balance.residual:.3f} N per N of load less than the platform's "
            f"motion and the rails need, {at_most}: a gauge has lost gain or its zero has moved, "
            "the angle is another one, or a calibration is wrong. Rubbing cannot do that.",
        )


def _budget(
    motion: Motion,
    torque: FloatArray,
    force: FloatArray,
    used: BoolArray,
    settings: BetterSettings,
    bending: Bending | None,
) -> Budget:
    """Return the budget of this run's F_r/N over the ``used`` blocks."""
    means, calibration = motion.means, motion.known.calibration
    scale = calibration.torque.value
    speed = float(np.mean(means.wheel_speed_rad_s[used]))
    seconds = settings.block_s * float(np.count_nonzero(used))
    learnt = bending is not None and math.isfinite(bending.zero_u_nm)
    at = Conditions(
        mu=max(abs(float(np.sum(force[used]) / np.sum(means.normal_force_n[used]))), 1e-6),
        torque_nm=float(np.mean(torque[used])),
        normal_force_n=float(np.mean(means.normal_force_n[used])),
        wheel_speed_rad_s=speed,
        wheel_acceleration_rad_s2=float(np.mean(means.wheel_acceleration_rad_s2[used])),
        travel_m=float(np.mean(means.platform_travel_m[used])),
        turns=abs(speed) * seconds / (2.0 * math.pi),
        samples=round(seconds / motion.period_s),
    )
    sizes = Sizes(
        zero_nm=bending.zero_u_nm if bending and learnt else _zero_nm(motion, settings),
        tare_nm=abs(scale) * motion.tare_u_v,
        tared=bending is not None and math.isfinite(motion.tare_v),
        noise_nm=abs(scale) * motion.noise_v,
        crosstalk=settings.crosstalk_m if bending is None else bending.amplitude,
        crosstalk_u=settings.crosstalk_m if bending is None else bending.u,
        scatter=settings.scatter_u,
        scatter_kind="B",
        inertia=settings.inertia_u,
        load_reading_n=settings.load_reading_u_n,
        load_change=_load_change(at.mu, float(np.mean(means.t_s[used])), settings),
        load_cell=motion.known.run.normal_force_v is not None
        and calibration.normal_force is not None,
        vibration=settings.vibration_u,
    )
    return budget(at, calibration, motion.known.rig, sizes)


def _load_change(mu: float, t_s: float, settings: BetterSettings) -> float:
    """Return the relative standard uncertainty of N at ``t_s`` beside its rise along the rails.

    N rises as the platform tilts under the traction and falls as the ground settles. Neither is
    corrected. Each size has a rectangular distribution from 0 to twice the assumed one (JCGM
    100:2008, 4.3.7), and the difference of the means counts with its full size (F.2.4.5).
    """
    tilted = settings.tilting * mu
    settled = settings.settling * -math.expm1(-t_s / settings.settling_s)
    return math.hypot(tilted - settled, tilted / math.sqrt(3.0), settled / math.sqrt(3.0))


def _zero_nm(motion: Motion, settings: BetterSettings) -> float:
    """Return the standard uncertainty of a zero that stays in the torque, in N m.

    Before the trigger the gauges show it, with the crosstalk of the start's angle.
    """
    assumed, seen = settings.zero_u_v, abs(motion.tare_v)
    most = max(assumed, seen) if math.isfinite(seen) else assumed
    return abs(motion.known.calibration.torque.value) * most
