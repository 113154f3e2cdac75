"""Builds the metadata of a recording: run, versions, parameters, overrides, analysis plan."""

from __future__ import annotations

import platform
import shutil
import subprocess
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from rigd import __version__
from rigd.config.rig import RigConfig
from rigd.model.units import Quantity, parse_unit
from rigd.procedure.identify import plan_metadata
from rigd.procedure.program import CompiledProcedure, TrialPlan

_PACKAGE = Path(__file__).resolve().parent.parent


def run_metadata(
    procedure: CompiledProcedure,
    rig: RigConfig,
    *,
    seed: int,
    start_ns: int,
    mode: str,
    overrides: Mapping[str, str],
) -> dict[str, dict[str, str]]:
    """Return the metadata records of a run: ``run``, ``parameters``, ``overrides``, ``identify``.

    ``mode`` is ``simulated, virtual time`` or the like.
    """
    records = {
        "run": {
            "procedure": procedure.name,
            "title": procedure.title,
            "rig": rig.name,
            "mode": mode,
            "seed": str(seed),
            "started": datetime.fromtimestamp(start_ns * 1e-9, UTC).isoformat(),
            "trials": str(len(procedure.trials)),
            "rigd_version": __version__,
            "git_revision": git_revision(),
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
        "parameters": {
            name: format_parameter(value, procedure.units.get(name))
            for name, value in procedure.parameters.items()
        },
        "overrides": dict(overrides),
    }
    plan = procedure.identify
    if plan is not None:
        records["identify"] = plan_metadata(plan)
    return records


def format_parameter(value: float | str | bool, unit: str | None) -> str:
    """Return a parameter as a person writes it: ``0.15 A``, ``pvc``."""
    if isinstance(value, str | bool) or unit is None:
        return str(value)
    return str(Quantity(float(value), parse_unit(unit)))


def trial_label(trial: TrialPlan, procedure: CompiledProcedure) -> str:
    """Return the parameters that distinguish a trial, such as ``current 0.15 A, repeat 2``."""
    words = [
        f"{name} {format_parameter(value, procedure.units.get(name))}"
        for name, value in trial.parameters.items()
        if name not in procedure.parameters or procedure.parameters[name] != value
    ]
    return ", ".join([*words, *([f"repeat {trial.repeat}"] if trial.repeat > 1 else [])])


def git_revision() -> str:
    """Return the revision of the checkout of rigd, ``-dirty`` with local changes.

    Empty if rigd does not run from a checkout.
    """
    if not (_PACKAGE.parent / ".git").exists():
        return ""
    if shutil.which("git") is None:
        return ""
    described = subprocess.run(
        ["git", "-C", str(_PACKAGE.parent), "describe", "--always", "--dirty", "--abbrev=12"],
        capture_output=True,
        text=True,
        check=False,
    )
    return described.stdout.strip()
