"""Plays a compiled procedure on the simulated plant and records nothing (a dry run)."""

from rigd.dry_run.play import DryRunResult, PredictedPeak, dry_run
from rigd.dry_run.steps import StepRow

__all__ = ["DryRunResult", "PredictedPeak", "StepRow", "dry_run"]
