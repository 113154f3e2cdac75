"""One run of the approach-angle rig, evaluated by the corrected method as a campaign does it."""

from __future__ import annotations

from rigd_analyses.approach_angle.better.bending import Bending
from rigd_analyses.approach_angle.better.motion import motion
from rigd_analyses.approach_angle.better.result import BetterRun
from rigd_analyses.approach_angle.better.run import evaluate, no_numbers, usable
from rigd_analyses.approach_angle.better.settings import BetterSettings
from rigd_analyses.approach_angle.raw.flags import raw_flags
from rigd_analyses.approach_angle.raw.run_data import AngleCalibration, AngleRig, AngleRun, KnownRun


def analyse_better(
    run: AngleRun,
    calibration: AngleCalibration,
    rig: AngleRig,
    settings: BetterSettings | None = None,
    bending: Bending | None = None,
) -> BetterRun:
    """Return friction, slip and the force balance of ``run``."""
    settings = settings or BetterSettings()
    flags = raw_flags(run, calibration, rig, settings.limits)
    if not usable(run, flags):
        return no_numbers(flags)
    moves = motion(KnownRun(run, calibration, rig), settings)
    return evaluate(moves, settings, flags=flags, bending=bending)
