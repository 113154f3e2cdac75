"""Judges whether a run would start: plays the dry run, and checks the calibration of the rig."""

from __future__ import annotations

from dataclasses import replace

from rigd.config.rig import RigConfig
from rigd.daemon.calibration_check import needed, unusable
from rigd.daemon.execute import day_of
from rigd.dry_run import DryRunResult, dry_run
from rigd.procedure.program import CompiledProcedure


def rehearse(
    procedure: CompiledProcedure, rig: RigConfig, seed: int, start_ns: int | None = None
) -> DryRunResult:
    """Play ``procedure`` as :func:`rigd.dry_run.dry_run` does, and look at the calibration, too.

    ``start_ns`` is when the run is asked to begin, None for now: calibrated values expire.

    Raises:
        Blocked: preflight refuses, or the sibling lacks what the procedure uses.
        ConfigError: the sibling is wrong.
    """
    found = dry_run(procedure, rig, seed)
    unfit = unusable(rig, needed(procedure, rig), day_of(start_ns))
    return replace(found, refusals=(*found.refusals, *unfit))
