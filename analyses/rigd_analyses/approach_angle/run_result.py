"""Defines the result of one run under both analyses, for the result of its campaign."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rigd_analyses.approach_angle.better.result import BetterRun
from rigd_analyses.approach_angle.paper.result import PaperRun
from rigd_analyses.approach_angle.raw.run_data import AngleRun, Flag, Severity


@dataclass(frozen=True)
class RunResult:
    """One run under both analyses; ``flags`` are those of the raw run and of both, each once."""

    run: AngleRun
    paper: PaperRun
    better: BetterRun
    flags: tuple[Flag, ...]

    @property
    def excluded(self) -> bool:
        """Whether a flag excludes the run."""
        return any(flag.severity is Severity.EXCLUDED for flag in self.flags)

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object; the signals stand in the recording."""
        run = self.run
        return {
            "label": run.label,
            "trial": run.number,
            "recording": run.recording,
            "set": run.set_name,
            "angle_deg": math.degrees(run.alpha_rad),
            "announced_load_kg": run.announced_load_kg,
            "load_N": run.load_n,
            "motor_voltage_V": run.voltage_v,
            "repeat": run.repeat,
            "excluded": self.excluded,
            "paper": self.paper,
            "better": self.better,
            "run_on": run.run_on,
            "flags": self.flags,
        }
