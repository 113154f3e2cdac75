"""Evaluates the recordings of one approach-angle campaign: result, report, JSON, terminal table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote

from rigd.analysis import Evaluation, Options
from rigd.analysis.estimates import Estimate
from rigd.analysis.provenance import provenance
from rigd.analysis.recordings.source import COMPLETE, RecordedSweep
from rigd.analysis.report import Heading, Opening, Provenance
from rigd.analysis.terminal import TerminalReport
from rigd_analyses.approach_angle.better.settings import BetterSettings
from rigd_analyses.approach_angle.campaign.campaign import analyse_campaign
from rigd_analyses.approach_angle.paper.settings import PaperSettings
from rigd_analyses.approach_angle.raw.good_run_limits import Limits
from rigd_analyses.approach_angle.raw.known_quantities import (
    Calibrated,
    angle_calibration,
    angle_rig,
    calibration_of,
)
from rigd_analyses.approach_angle.raw.run_data import KnownRun, SetReference
from rigd_analyses.approach_angle.raw.runs import find_signals, read_run, telling_attempts
from rigd_analyses.approach_angle.report.opening import campaign_opening
from rigd_analyses.approach_angle.report.terminal import campaign_terminal_report
from rigd_analyses.approach_angle.result import CampaignResult, file_names


@dataclass(frozen=True)
class CampaignEvaluation(Evaluation):
    """The result of a campaign, the calibration behind it, and the origin of its data."""

    title: str
    result: CampaignResult
    recordings: tuple[Path, ...]
    calibrations: Mapping[Path, Calibrated]  #: of each recording
    provenance: Provenance

    @property
    def opening(self) -> Opening:
        """Which maxima may be used, and which may not."""
        return campaign_opening(self.result)

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The three coefficients of each set, dimensionless, with value ± 2 u."""
        return tuple(item for found in self.result.sets for item in found.estimates)

    @property
    def heading(self) -> Heading:
        """Origin of the data."""
        return self.provenance.heading

    def report(self) -> str:
        """Return the report as a self-contained HTML page; 4 s for five sets."""
        # Here, so that a command that only names this module does not wait for matplotlib.
        from rigd.analysis.report.page import render
        from rigd_analyses.approach_angle.report.view import TEMPLATES, build_campaign_view

        return render(
            "campaign.html.jinja",
            lambda: build_campaign_view(self.result, self.calibrations_told),
            self.provenance,
            self.title,
            TEMPLATES,
            self.opening,
        )

    def to_json(self) -> dict[str, object]:
        """Return the results as an object for ``json.dumps``.

        That of the campaign, with ``recordings`` and the calibration used for each.
        """
        return {
            **self.result.to_json(),
            "title": self.title,
            "recordings": [str(path) for path in self.recordings],
            "calibrations": [
                {
                    "recording": str(path),
                    "name": calibration.used.name,
                    "sha256": calibration.used.sha256,
                    "replayed": calibration.replayed,
                    "changes": list(calibration.changes),
                }
                for path, calibration in self.calibrations.items()
            ],
        }

    def terminal_report(self) -> TerminalReport:
        """Return Table 1, the trend, what was flagged, and the calibration."""
        return campaign_terminal_report(self.result, self.calibrations_told)

    @property
    def calibrations_told(self) -> tuple[str, ...]:
        """Which calibration was used for which recordings, and what it changed, a line each."""
        short = file_names(str(path) for path in self.calibrations)
        names_of: dict[tuple[str, tuple[str, ...]], list[str]] = {}
        for path, calibration in self.calibrations.items():
            same = names_of.setdefault((calibration.described, calibration.changes), [])
            same.append(short[str(path)])
        several = len(names_of) > 1
        lines = []
        for (words, changes), names in names_of.items():
            of = f" ({', '.join(names)})" if several else ""
            changed = f": {'; '.join(changes)}" if changes else ""
            lines.append(f"Calibration {words}{of}{changed}.")
        return tuple(lines)


def evaluate(
    sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
) -> CampaignEvaluation:
    """Return the result of ``sweeps``, the recordings of one campaign.

    Runs that are bad or not whole are flagged and shown, never dropped without a word.

    Raises:
        RecordingError: a recording is damaged.
        ConfigError: a calibration is wrong.
        DataError: a recording carries no calibration and none is given, or lacks a signal,
            parameter or constant.
    """
    calibrations = {sweep.path: calibration_of(sweep, options.calibration) for sweep in sweeps}
    known = known_runs(sweeps, calibrations)
    notify(f"{len(known)} runs of {', '.join(sweep.path.name for sweep in sweeps)}")
    better = settings_of(sweeps)
    paper = PaperSettings(limits=better.limits)
    result = analyse_campaign(known, _reference(sweeps), paper, better)
    told = (*_unfinished(sweeps), *_unused(sweeps, better.inertia_u))
    result = replace(result, warnings=(*told, *result.warnings))
    used = [
        sum(not run.excluded for run in result.runs if run.run.recording == str(sweep.path))
        for sweep in sweeps
    ]
    origin = provenance(
        sweeps,
        used,
        {"paper's method": "angle.paper", "corrected method": "angle.better"},
        [{"calibration": calibrations[sweep.path].described} for sweep in sweeps],
    )
    titles = dict.fromkeys(sweep.info.procedure.replace("_", " ") for sweep in sweeps)
    rigs = dict.fromkeys(sweep.info.rig for sweep in sweeps)
    title = f"{', '.join(titles).capitalize()} on {', '.join(rigs)}"
    return CampaignEvaluation(
        title, result, tuple(sweep.path for sweep in sweeps), calibrations, origin
    )


def settings_of(sweeps: Sequence[RecordedSweep]) -> BetterSettings:
    """Return the settings; the constant ``pre_trigger`` is the least time before the command.

    0 s accepts records that have none, as the paper's own; the smallest of all recordings counts.
    """
    given = [
        sweep.constant(sweep.info.trials[0], "pre_trigger")
        for sweep in sweeps
        if "pre_trigger" in sweep.plan.constants
    ]
    limits = Limits()
    if given:
        limits = replace(limits, pre_trigger_s=max(0.0, min(given)))
    return BetterSettings(limits=limits)


def known_runs(
    sweeps: Sequence[RecordedSweep], calibrations: Mapping[Path, Calibrated]
) -> list[KnownRun]:
    """Return the run of every trial, each with the calibration and rig of its recording."""
    known = []
    for sweep in sweeps:
        used = calibrations[sweep.path].used
        calibration, signals = angle_calibration(sweep, used), find_signals(sweep)
        for trial in telling_attempts(sweep.info.trials):
            run = read_run(sweep, trial, signals)
            known.append(KnownRun(run, calibration, angle_rig(sweep, trial, used)))
    return known


def _reference(sweeps: Sequence[RecordedSweep]) -> SetReference | None:
    """Return the published maximum of each set, None if the plans have none."""
    values = {
        name.rpartition(".")[0]: value
        for sweep in sweeps
        for name, value in sweep.plan.reference.items()
        if "." in name
    }
    labels = [sweep.plan.reference_label for sweep in sweeps if sweep.plan.reference]
    return SetReference(labels[0], values) if values else None


def _unused(sweeps: Sequence[RecordedSweep], inertia_u: float) -> list[str]:
    """Return a warning if uncertainties are stated that enter no interval."""
    stated = [
        name
        for name in ("wheel_radius", "wheel_inertia", "platform_mass", "gravity")
        if any(
            sweep.uncertainty(trial, name) for sweep in sweeps for trial in sweep.info.trials[:1]
        )
    ]
    if not stated:
        return []
    return [
        f"The uncertainty that is stated of {', '.join(stated)} enters no interval: these "
        f"constants are taken as exact, wheel_inertia as known to {inertia_u:.0%}."
    ]


def _unfinished(sweeps: Sequence[RecordedSweep]) -> list[str]:
    """Return a warning for each recording whose run did not come to its end."""
    names = file_names(str(sweep.path) for sweep in sweeps)
    found = []
    for sweep in sweeps:
        info, name = sweep.info, names[str(sweep.path)]
        if info.state != COMPLETE:
            why = f": {info.reason}" if info.reason else ""
            planned = info.metadata.get("run", {}).get("trials", "?")
            found.append(
                f"{name}: the run did not come to its end ({info.state}{why}); {info.trials_done} "
                f"of {planned} trials are complete. `rigd run --resume {quote(name)}` plays the "
                "others."
            )
    return found
