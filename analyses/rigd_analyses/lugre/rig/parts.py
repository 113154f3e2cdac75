"""Selects the part of each trial in which only the motor moves the carriage; rejects the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigd.analysis import DataError
from rigd.analysis.result import RowsUsed, TrialRejection
from rigd_analyses.lugre.rig.system import LEAD
from rigd_analyses.lugre.slip_force.identify import Settings
from rigd_analyses.lugre.trials.drive import find_drive
from rigd_analyses.lugre.trials.rows import jump
from rigd_analyses.lugre.trials.slip_and_traction import window_samples
from rigd_analyses.lugre.trials.trial import LugreTrial

LEAST_TRIALS = 3
MARGIN = 5  #: samples before the end of a drive that the current alone shows
LEAST_TRAVEL_M = 0.02
LEAST_SPEED_M_S = 0.03  #: a carriage that creeps sticks and slips, which no law of sliding has
SPEED_OVER_S = 0.1
STANDS_M = 1e-3  #: a carriage that moves by less, for `SPEED_OVER_S` or longer, stands
TURNS = 0.1  #: share of its whole turn that a wheel beside a standing carriage has


def sort_out(
    trials: Sequence[LugreTrial], periods: Sequence[float], settings: Settings
) -> tuple[list[tuple[LugreTrial, slice]], list[TrialRejection]]:
    """Return the trials that move, each with the part that is simulated, and the others."""
    kept, rejected = [], []
    for trial, period in zip(trials, periods, strict=True):
        part = free_part(trial, period, settings)
        travel = float(np.ptp(trial.carriage_position_m[part]))
        if abs(period - periods[0]) > 1e-3 * periods[0]:
            rejected.append(
                TrialRejection(trial.label, "it is sampled at another rate", len(trial.t_s))
            )
        elif travel < LEAST_TRAVEL_M:
            rejected.append(
                TrialRejection(
                    trial.label,
                    f"the carriage moved {1e3 * travel:.1f} mm while driven",
                    len(trial.t_s),
                )
            )
        elif np.ptp(trial.wheel_angle_rad[part]) == 0.0:
            rejected.append(
                TrialRejection(
                    trial.label,
                    f"the wheel encoder shows no turn while the carriage moved {1e3 * travel:.0f} "
                    "mm; check its wiring",
                    len(trial.t_s),
                )
            )
        elif (speed := _top_speed(trial, part, period)) < LEAST_SPEED_M_S:
            rejected.append(
                TrialRejection(
                    trial.label,
                    f"the carriage crept at {1e3 * speed:.0f} mm/s at most: friction close to "
                    "standstill is not what the model describes",
                    len(trial.t_s),
                )
            )
        elif spoilt := _stopped(trial, part, period) or jump(trial, part):
            rejected.append(TrialRejection(trial.label, spoilt, len(trial.t_s)))
        else:
            kept.append((trial, part))
    if len(kept) < LEAST_TRIALS:
        reasons = "; ".join(f"{item.label}: {item.reason}" for item in rejected)
        raise DataError(
            f"{len(kept)} of {len(trials)} trials can be fitted, need at least {LEAST_TRIALS}"
            + (f" ({reasons})" if reasons else ""),
            hint="record a sweep of currents that move the carriage",
        )
    return kept, rejected


def _top_speed(trial: LugreTrial, part: slice, period_s: float) -> float:
    """Return the largest speed of the carriage over 0.1 s, in m/s."""
    position = trial.carriage_position_m[part]
    steps = min(max(1, round(SPEED_OVER_S / period_s)), len(position) - 1)
    moved = np.abs(position[steps:] - position[:-steps])
    return float(np.max(moved, initial=0.0)) / (steps * period_s)


def _stopped(trial: LugreTrial, part: slice, period_s: float) -> str:
    """Return that the carriage stands at the end while the wheel turns on; empty if it does not."""
    position, angle = trial.carriage_position_m[part], trial.wheel_angle_rad[part]
    away = np.flatnonzero(np.abs(position - position[-1]) > STANDS_M)
    stands = int(away[-1]) + 1 if away.size else 0
    turned = abs(float(angle[-1] - angle[stands])) / float(np.ptp(angle))
    if (len(position) - stands) * period_s < SPEED_OVER_S or turned < TURNS:
        return ""
    at_s = float(trial.t_s[part][stands] - trial.t_s[0])
    return (
        f"the carriage stands still from {at_s:.2f} s after its begin on while the wheel turns on "
        f"({turned:.0%} of its turn); look for what stops it, and at its encoder"
    )


def rows_used(trial: LugreTrial, part: slice) -> RowsUsed:
    """Return how many rows of ``trial`` are simulated, and why the others are not."""
    after = (
        "after the first drop of the current (no signal carriage_held)"
        if trial.held is None
        else "after the end (carriage held)"
    )
    reasons = {"before the start": part.start, after: len(trial.t_s) - part.stop}
    return RowsUsed(part.stop - part.start, {why: n for why, n in reasons.items() if n})


def free_part(trial: LugreTrial, period_s: float, settings: Settings) -> slice:
    """Return the part in which the motor alone moves the carriage.

    It begins shortly before the current step. It ends when something holds the carriage, if that
    was recorded, else with the first drive.

    Raises:
        DataError: there is no step of the current, or too little rest before it.
    """
    drive = find_drive(trial, period_s, window_samples(settings.guards, period_s))
    if drive.start < LEAD:
        raise DataError(
            f"trial {trial.label}: {drive.start} samples of rest "
            f"({1e3 * drive.start * period_s:.0f} ms) before the current step, need {LEAD} "
            f"({1e3 * LEAD * period_s:.0f} ms) to simulate the rig",
            hint="start recording earlier or sample faster; `--method slip-force` needs less rest",
        )
    end = drive.end - MARGIN
    if trial.held is not None:
        after = np.flatnonzero(trial.held[drive.start + 1 :] > 0.5)
        end = len(trial.held) if after.size == 0 else drive.start + 1 + int(after[0])
    return slice(drive.start - LEAD, end)
