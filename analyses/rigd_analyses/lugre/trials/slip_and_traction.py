"""Converts raw channels to slip and traction (method A), with checks against bad data (guards).

The fit takes slip as input and force as output, and both have errors (errors-in-variables). Each
guard therefore prevents one way in which careless processing shifts the parameters (lugre.md
sections 5 and 8 measure by how much). The module returns a text of what it did, for the report.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from rigd.analysis import DataError
from rigd.analysis.friction import SlipForce
from rigd.analysis.result import FloatArray, Preprocessing, TrialRejection
from rigd_analyses.lugre.trials.drive import MIN_REST_S, Drive, find_drive
from rigd_analyses.lugre.trials.identical_trials import refuse_alike
from rigd_analyses.lugre.trials.rows import jump
from rigd_analyses.lugre.trials.trial import LugreConstants, LugreTrial, sampling_period_s

FORWARD, REVERSE = 1.0, -1.0


@dataclass(frozen=True)
class Guards:
    """Settings of method A, with the values that lugre.md section 5 derives.

    ``window_s``: Savitzky-Golay window, the same for slip and force. ``order``: its polynomial.
    ``min_speed_m_s``: below this carriage speed Eq. 34 does not hold (friction at rest equals
    the applied force). ``min_travel_m``, ``min_peak_m_s``: a trial that moves less, or never
    faster, creeps or does not move, and its few samples near standstill do not describe sliding
    (0.15 A on stone peaks at 33 mm/s). ``still_m`` and ``settle_s``: the accelerometer's zero is
    taken when the carriage has stayed within the one for at least the other (0.5 s of "rest" on
    PVC that begin with a moving carriage cost sigma_0 17 %). ``min_used_s``: a trial with less
    usable data than this is left out.
    """

    window_s: float = 0.031
    order: int = 2
    min_speed_m_s: float = 0.03
    min_travel_m: float = 0.05
    min_peak_m_s: float = 0.1
    still_m: float = 0.1e-3
    settle_s: float = 0.1
    min_used_s: float = 0.1
    min_trials: int = 3


@dataclass(frozen=True, eq=False)
class ProcessedTrial:
    """One trial after method A: the input of the model, and further signals for a plot.

    All arrays (n,) from the first sample of the recording to the end of the drive; speeds in m/s,
    ``traction_n`` in N. Trials that drove backwards are mirrored. ``slip_noise_m_s`` is the
    standard deviation that the encoders' counts leave in the slip after the filter.
    """

    label: str
    current_a: float
    t_s: FloatArray
    wheel_speed_m_s: FloatArray
    carriage_speed_m_s: FloatArray
    traction_n: FloatArray
    samples: SlipForce
    drive: Drive
    acceleration_bias_m_s2: float
    slip_noise_m_s: float
    recording: str


@dataclass(frozen=True)
class ProcessedSweep:
    """The trials that can be fitted, and the text of how they were processed."""

    trials: tuple[ProcessedTrial, ...]
    constants: LugreConstants
    guards: Guards
    account: Preprocessing = field(repr=False)


def process(
    trials: Sequence[LugreTrial], constants: LugreConstants, guards: Guards | None = None
) -> ProcessedSweep:
    """Return slip and traction of every trial that moved.

    Raises DataError for unusable recordings, a reversed sign, too few moving trials, and trials
    that are all the same test.
    """
    guards = Guards() if guards is None else guards
    kept: list[ProcessedTrial] = []
    driven: list[tuple[LugreTrial, slice]] = []
    rejected: list[TrialRejection] = []
    for trial in trials:
        outcome = process_trial(trial, constants, guards)
        if isinstance(outcome, TrialRejection):
            rejected.append(outcome)
        else:
            kept.append(outcome)
            driven.append((trial, slice(outcome.drive.start, outcome.drive.end)))
    if len(kept) < guards.min_trials:
        reasons = "; ".join(f"{r.label}: {r.reason}" for r in rejected)
        raise DataError(
            f"{len(kept)} of {len(trials)} trials can be fitted, need at least {guards.min_trials}"
            + (f" ({reasons})" if reasons else ""),
            hint="record a sweep of currents that move the carriage",
        )
    _check_sign(kept)
    refuse_alike(driven)
    return ProcessedSweep(tuple(kept), constants, guards, _account(kept, rejected, guards))


def process_trial(
    trial: LugreTrial, constants: LugreConstants, guards: Guards
) -> ProcessedTrial | TrialRejection:
    """Return one trial as slip and traction up to the end of its drive, or why it is left out."""
    period = sampling_period_s(trial)
    window = window_samples(guards, period)
    drive = find_drive(trial, period, window)
    end = drive.end
    direction = REVERSE if trial.current_a < 0.0 else FORWARD
    position = direction * trial.carriage_position_m[:end]
    travel = float(position[-1] - position[0])
    if abs(travel) < guards.min_travel_m:
        return TrialRejection(
            trial.label,
            f"the carriage moved {1e3 * travel:.1f} mm while driven, need "
            f"{1e3 * guards.min_travel_m:.0f} mm",
        )
    if end - drive.start < 2 * window:
        return TrialRejection(trial.label, "the drive is shorter than two filter windows")
    jumped = jump(trial, slice(max(drive.start - window, 0), end))
    if jumped:
        return TrialRejection(trial.label, jumped)
    rim = direction * constants.wheel_radius_m * trial.wheel_angle_rad[:end]
    rest = _rest(position, drive.start - window, guards, period)
    if (rest.stop - rest.start) * period < MIN_REST_S:
        return TrialRejection(
            trial.label,
            f"the carriage stands still for only {1e3 * (rest.stop - rest.start) * period:.0f} ms "
            f"before the current step, need {1e3 * MIN_REST_S:.0f} ms for the accelerometer's zero",
        )
    bias = float(np.mean(trial.acceleration_m_s2[rest]))
    acceleration = direction * (trial.acceleration_m_s2[:end] - bias)

    # The filter runs over the drive alone: reaching across the step it would smear the jump of
    # the slip, which costs sigma_0 3 % on PVC (a bristle that has moved less than it did).
    moving = slice(drive.start, end)
    wheel_speed, carriage_speed, inertial = np.zeros(end), np.zeros(end), np.zeros(end)
    wheel_speed[moving] = rate(rim[moving], period, window, guards.order)
    carriage_speed[moving] = rate(position[moving], period, window, guards.order)
    inertial[moving] = constants.mass_kg * smooth(acceleration[moving], window, guards.order)
    peak = float(np.max(np.abs(carriage_speed)))
    if peak < guards.min_peak_m_s:
        return TrialRejection(
            trial.label,
            f"the carriage creeps: {1e3 * peak:.0f} mm/s at most, need "
            f"{1e3 * guards.min_peak_m_s:.0f} mm/s",
        )
    slip = wheel_speed - carriage_speed
    slip[: drive.start + 1] = 0.0
    traction = inertial + constants.resistance_n * np.sign(carriage_speed)

    half = window // 2 + 1
    mask = np.abs(carriage_speed) >= guards.min_speed_m_s
    mask[: drive.start + half] = False
    mask[end - half :] = False
    if np.count_nonzero(mask) * period < guards.min_used_s:
        return TrialRejection(
            trial.label,
            f"only {1e3 * np.count_nonzero(mask) * period:.0f} ms are faster than "
            f"{guards.min_speed_m_s} m/s, need {1e3 * guards.min_used_s:.0f} ms",
        )
    samples = SlipForce(
        trial.label, period, slip, traction / constants.normal_force_n, mask.astype(np.float64),
        wheel_speed,
    )  # fmt: skip
    return ProcessedTrial(
        trial.label, trial.current_a, trial.t_s[:end], wheel_speed, carriage_speed, traction,
        samples, drive, bias,
        slip_noise(rim[moving], position[moving], period, window, guards.order), trial.recording,
    )  # fmt: skip


def _rest(position: FloatArray, end: int, guards: Guards, period_s: float) -> slice:
    """Return the last stretch before sample ``end`` in which the carriage has come to rest."""
    moved = np.flatnonzero(np.abs(position[:end] - position[end]) > guards.still_m)
    if moved.size == 0:
        return slice(0, end)
    return slice(min(int(moved[-1]) + 1 + round(guards.settle_s / period_s), end), end)


def window_samples(guards: Guards, period_s: float) -> int:
    """Return the window in samples: odd, and longer than the polynomial order."""
    count = round(guards.window_s / period_s)
    count += 1 - count % 2
    if count <= guards.order + 1:
        raise DataError(
            f"a window of {1e3 * guards.window_s:.0f} ms holds {count} samples at "
            f"{1 / period_s:.0f} Hz, need more than {guards.order + 1}",
            hint="record faster, or widen the window",
        )
    return count


def smooth(values: FloatArray, window: int, order: int) -> FloatArray:
    """Return ``values`` (n,) smoothed with zero phase; the ends by the polynomial's own ends."""
    return np.asarray(savgol_filter(values, window, order, mode="interp"), dtype=np.float64)


def rate(position: FloatArray, period_s: float, window: int, order: int) -> FloatArray:
    """Return d(position)/dt (n,) with zero phase, from the same polynomial as :func:`smooth`."""
    slope = savgol_filter(position, window, order, deriv=1, delta=period_s, mode="interp")
    return np.asarray(slope, dtype=np.float64)


def slip_noise(
    rim: FloatArray, position: FloatArray, period_s: float, window: int, order: int
) -> float:
    """Return the standard deviation in m/s that white noise of both positions leaves in the slip.

    The noise of a position is seen in its second differences, sqrt(6) times as large there; what
    the carriage really accelerates within one sample is a tenth of a count. Both arrays in m.
    """
    variance = sum(float(np.var(np.diff(x, 2))) / 6.0 for x in (rim, position))
    gain = savgol_coeffs(window, order, deriv=1, delta=period_s)
    return float(np.sqrt(variance * np.sum(gain**2)))


def _check_sign(trials: Sequence[ProcessedTrial]) -> None:
    """Slip and traction must rise together; a reversed one drives every fit to its bounds."""
    slip = np.concatenate([t.samples.slip_m_s[t.samples.mask > 0.0] for t in trials])
    force = np.concatenate([t.samples.force[t.samples.mask > 0.0] for t in trials])
    if np.ptp(slip) == 0.0 or np.ptp(force) == 0.0:
        raise DataError(
            "the slip or the traction is constant over all trials; nothing can be fitted",
            hint="check that wheel and carriage encoder both count",
        )
    correlation = float(np.corrcoef(slip, force)[0, 1])
    if not correlation > 0.0 or np.mean(slip) < 0.0:
        raise DataError(
            f"slip and traction run against each other (correlation {correlation:+.2f}, mean slip "
            f"{1e3 * float(np.mean(slip)):+.1f} mm/s while driving forwards; both must be above 0)",
            hint="the sign or the wiring of the wheel encoder, the carriage encoder, the "
            "accelerometer or the motor current is wrong; check the calibration's sign",
        )


def _trials(count: int) -> str:
    return "1 trial" if count == 1 else f"{count} trials"


def _account(
    kept: Sequence[ProcessedTrial], rejected: Sequence[TrialRejection], guards: Guards
) -> Preprocessing:
    window = window_samples(guards, kept[0].samples.period_s)
    used = sum(int(np.count_nonzero(t.samples.mask)) for t in kept)
    return Preprocessing(
        statements=(
            f"Speeds and acceleration come from the same zero-phase Savitzky-Golay filter (order "
            f"{guards.order}, {window} samples, {1e3 * window * kept[0].samples.period_s:.0f} ms), "
            "run over the drive alone so that the jump at the current step is not smeared.",
            "The accelerometer's zero is its mean over the standstill before each step.",
            "Traction is F = m a + guide friction + rolling resistance, both kinetic.",
            f"Samples slower than {guards.min_speed_m_s} m/s, within half a window of a current "
            "step, and after the end of the drive do not count; slip is zero before the step.",
            f"{used} samples of {_trials(len(kept))} count; left out: {_trials(len(rejected))}.",
        ),
        settings={
            "window_s": guards.window_s,
            "polynomial_order": float(guards.order),
            "min_speed_m_s": guards.min_speed_m_s,
            "min_travel_m": guards.min_travel_m,
            "phase": "zero",
        },
        per_trial={
            t.label: {
                "acceleration_bias_m_s2": t.acceleration_bias_m_s2,
                "drive_start_s": float(t.t_s[t.drive.start]),
                "drive_end_s": float(t.t_s[-1]),
                "samples_used": float(np.count_nonzero(t.samples.mask)),
                "max_slip_m_s": float(np.max(t.samples.slip_m_s)),
                "slip_noise_m_s": t.slip_noise_m_s,
            }
            for t in kept
        },
        rejected=tuple(rejected),
    )
