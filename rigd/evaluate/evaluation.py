"""Recordings in; identification per group, provenance and report out."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from rigd import __version__
from rigd.evaluate.models import needs_of
from rigd.evaluate.source import RecordedSweep, open_sweep
from rigd.identify.report import (
    Attachment,
    Facts,
    Provenance,
    ReportSection,
    render_report,
)
from rigd.model.errors import DataError
from rigd.record import TrialInfo


@dataclass(frozen=True)
class Options:
    """How to identify: number of starts, their seed, robust loss instead of least squares."""

    starts: int = 8
    seed: int = 1
    robust: bool = False


@dataclass(frozen=True)
class Evaluation:
    """The result of each group, in the order the recordings were given, and where it is from."""

    title: str
    sections: tuple[ReportSection, ...]
    recordings: tuple[tuple[Path, ...], ...]  #: those of each section
    provenance: Provenance

    def report(self) -> str:
        """Return the report as a self-contained HTML page."""
        return render_report(self.sections, self.provenance, title=self.title)

    def to_json(self) -> dict[str, object]:
        """Return the results as an object for ``json.dumps``.

        Of a single group it is the group's own object (``parameters``, ``friction_curve``, …)
        with ``group`` and ``recordings``; of several, ``groups`` is a list of such objects.
        """
        groups = [
            {
                "group": section.label,
                "recordings": [str(path) for path in paths],
                **section.result.to_json(),
            }
            for section, paths in zip(self.sections, self.recordings, strict=True)
        ]
        return groups[0] if len(groups) == 1 else {"groups": groups}


def evaluate(
    paths: Sequence[Path],
    options: Options | None = None,
    *,
    tell: Callable[[str], None] = lambda _: None,
) -> Evaluation:
    """Identify what ``paths`` hold; trials of one group may stand in several recordings.

    ``tell`` gets a line before each group is fitted.

    Raises:
        RecordingError: a file cannot be read.
        DataError: a file holds nothing to identify, or the data cannot answer.
    """
    options = options or Options()
    sweeps = [open_sweep(path) for path in dict.fromkeys(paths)]
    models = {sweep.plan.model for sweep in sweeps}
    if len(models) > 1:
        raise DataError(f"the recordings identify different models: {', '.join(sorted(models))}")
    model = import_module(needs_of(sweeps[0].plan).module)
    sections = []
    recordings = []
    for label, trials in _groups(sweeps).items():
        tell(f"{label}: {len(trials)} trials")
        result = model.identify(
            trials, starts=options.starts, seed=options.seed, robust=options.robust
        )
        recordings.append(tuple(dict.fromkeys(sweep.path for sweep, _ in trials)))
        plan = trials[0][0].plan
        if not plan.reference:
            sections.append(ReportSection(label, result))
            continue
        curve = model.reference_curve(plan.reference_label, plan.reference, result)
        sections.append(ReportSection(label, result, plan.reference, plan.reference_label, curve))
    titles = dict.fromkeys(section.result.title for section in sections)
    return Evaluation(
        ", ".join(titles), tuple(sections), tuple(recordings), _provenance(sweeps, options)
    )


def _groups(
    sweeps: Sequence[RecordedSweep],
) -> dict[str, list[tuple[RecordedSweep, TrialInfo]]]:
    """Return the trials by what `group_by` says of them; all under one label without it."""
    groups: dict[str, list[tuple[RecordedSweep, TrialInfo]]] = {}
    for sweep in sweeps:
        for trial in sweep.trials:
            words = [sweep.parameter(trial, name) for name in sweep.plan.group_by]
            label = ", ".join(words) or sweep.info.procedure
            groups.setdefault(label, []).append((sweep, trial))
    return groups


def _provenance(sweeps: Sequence[RecordedSweep], options: Options) -> Provenance:
    facts = [
        Facts(
            sweep.path.name,
            {
                "sha256": _sha256(sweep.path),
                **{name: value for name, value in sweep.info.metadata["run"].items() if value},
                **{f"parameter {name}": value for name, value in sweep.info.parameters.items()},
                "state": sweep.info.state,
                "trials used": str(len(sweep.trials)),
                **_bridged_facts(sweep),
            },
        )
        for sweep in sweeps
    ]
    facts.append(
        Facts(
            "Identification",
            {
                "rigd": __version__,
                "starts": str(options.starts),
                "seed": str(options.seed),
                "loss": "Huber" if options.robust else "least squares",
            },
        )
    )
    texts: dict[bytes, str] = {}
    for sweep in sweeps:
        for name, one in sweep.recording.attachments.items():
            texts.setdefault(one.data, name)
    attachments = [Attachment(name, data.decode(errors="replace")) for data, name in texts.items()]
    return Provenance(tuple(facts), tuple(attachments))


def _bridged_facts(sweep: RecordedSweep) -> dict[str, str]:
    """Return what there is to say of missing and late samples; nothing where there are none."""
    count = sum(sweep.bridged(trial) for trial in sweep.trials)
    return {"samples that were missing or late, and bridged": str(count)} if count else {}


def _sha256(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
