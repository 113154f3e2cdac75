"""Dry run: a compiled procedure played on the simulated plant, nothing recorded."""

from rigd.rehearsal.rehearse import Peak, Rehearsal, rehearse
from rigd.rehearsal.steps import StepRow

__all__ = ["Peak", "Rehearsal", "StepRow", "rehearse"]
