"""Dry run: a compiled procedure played on the simulated plant, nothing recorded."""

from rigd.dry_run.play import DryRunResult, PredictedPeak, dry_run
from rigd.dry_run.steps import StepRow

__all__ = ["DryRunResult", "PredictedPeak", "StepRow", "dry_run"]
