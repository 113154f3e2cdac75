"""Judges one run by itself, while the campaign goes on: swapped gauges show in the first run."""

from __future__ import annotations

from collections.abc import Sequence

from rigd.analysis.recordings.source import RecordedSweep, TrialInfo
from rigd_analyses.approach_angle.better.motion import motion
from rigd_analyses.approach_angle.better.run import evaluate, usable
from rigd_analyses.approach_angle.evaluation import settings_of
from rigd_analyses.approach_angle.mains import without_mains
from rigd_analyses.approach_angle.raw.flags import raw_flags
from rigd_analyses.approach_angle.raw.known_quantities import (
    angle_calibration,
    angle_rig,
    calibration_of,
)
from rigd_analyses.approach_angle.raw.run_data import KnownRun, Severity
from rigd_analyses.approach_angle.raw.runs import find_signals, read_run


def check_trial(sweep: RecordedSweep, trial: TrialInfo) -> Sequence[str]:
    """Return why ``trial`` would be left out; nothing if it would be used.

    Crosstalk and errors that all runs share show in a campaign only.

    Raises:
        RecordingError: a chunk of the recording is damaged.
        DataError: the recording lacks a signal, a constant, or its calibration.
    """
    used = calibration_of(sweep, None).used
    settings, calibration = settings_of([sweep]), angle_calibration(sweep, used)
    run = read_run(sweep, trial, find_signals(sweep))
    run = without_mains(run, calibration, settings.limits)
    known = KnownRun(run, calibration, angle_rig(sweep, trial, used))
    flags = raw_flags(run, known.calibration, known.rig, settings.limits)
    if usable(run, flags):
        flags = evaluate(motion(known, settings), settings, flags=flags).flags
    return [flag.reason for flag in flags if flag.severity is Severity.EXCLUDED]
