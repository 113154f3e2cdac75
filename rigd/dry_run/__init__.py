"""Plays a compiled procedure on a simulated plant and records nothing (a dry run)."""

from rigd.dry_run.play import DryRunResult, Physics, PredictedPeak, dry_run
from rigd.dry_run.steps import StepRow, Timing

__all__ = ["DryRunResult", "Physics", "PredictedPeak", "StepRow", "Timing", "dry_run"]
