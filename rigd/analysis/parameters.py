"""Evaluation by a model that is fitted: parameters with intervals, one set of them per group."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import Final, Protocol

from rigd.analysis.evaluation import Evaluation, Options
from rigd.analysis.provenance import provenance
from rigd.analysis.report import (
    Provenance,
    ReferenceCurve,
    ReportSection,
    SummaryRow,
    render_report,
    summary_rows,
)
from rigd.analysis.result import IdentificationResult, Verdict
from rigd.analysis.source import RecordedSweep
from rigd.analysis.terminal import Column, Row, Shown, Table
from rigd.model.errors import ConfigError, DataError
from rigd.record import TrialInfo

#: What the verdict adds, said once below the table instead of in every row.
FROM_HERE: Final = " from this excitation"

Trials = Sequence[tuple[RecordedSweep, TrialInfo]]


class Identify(Protocol):
    """Trials recorded under the same conditions to the parameters of a model."""

    def __call__(
        self, trials: Trials, *, starts: int, seed: int, robust: bool
    ) -> IdentificationResult:
        """Return them; raise DataError where the data cannot answer."""
        ...


#: Curve of published parameters, over the range that a result visited; None if they do not do.
DrawReference = Callable[[str, Mapping[str, float], IdentificationResult], ReferenceCurve | None]


@dataclass(frozen=True)
class ParameterEvaluation(Evaluation):
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

    def shown(self) -> Shown:
        """Return one table of all groups, and the advice below it."""
        rows = summary_rows(self.sections)
        paragraphs = []
        if any(row.verdict is Verdict.UNIDENTIFIABLE for row in rows):
            paragraphs.append(
                f"not identifiable:{FROM_HERE}; no number is printed for what is not known"
            )
        advised: dict[str, list[str]] = {}
        for row in rows:
            # The first sentence says what to do; the report has the rest.
            if row.advice:
                first = row.advice.partition(". ")[0].rstrip(".")
                advised.setdefault(first, []).append(f"{row.name} ({row.section})")
        if advised:
            lines = [f"  {', '.join(names)}: {advice}." for advice, names in advised.items()]
            paragraphs.append("\n".join(["what would help:", *lines]))
        for section in self.sections:
            used, left_out = len(section.result.trials), section.result.preprocessing.rejected
            told = [f"{section.label}: {used} of {used + len(left_out)} trials used"]
            told += [f"  {warning}" for warning in section.result.warnings]
            paragraphs.append("\n".join(told))
        return (self._table(rows), *paragraphs)

    def _table(self, rows: Sequence[SummaryRow]) -> Table:
        referenced = sorted({s.reference_label for s in self.sections if s.reference})
        columns = [
            Column(""),
            Column("parameter"),
            Column("estimate", right=True),
            Column("95 % interval", right=True),
            Column("unit"),
            *([Column(" / ".join(referenced), right=True)] if referenced else []),
            Column("verdict"),
        ]
        found = []
        last = ""
        for row in rows:
            cells = (
                row.section if row.section != last else "",
                row.name,
                f"{row.estimate_text} {row.spread_text}".strip() if row.known else "–",
                row.interval_text if row.known else "",
                row.unit,
                *([row.reference_text] if referenced else []),
                row.verdict.value.removesuffix(FROM_HERE),
            )
            found.append(Row(cells, faint=not row.known))
            last = row.section
        return Table(tuple(columns), tuple(found))


def evaluate_groups(
    sweeps: Sequence[RecordedSweep],
    options: Options,
    tell: Callable[[str], None],
    *,
    identify: Identify,
    draw_reference: DrawReference,
) -> ParameterEvaluation:
    """Return the parameters of each group of complete trials.

    Raises:
        ConfigError: a calibration is given: what is fitted here are the recorded values.
        DataError: a recording has no complete trial, or the data cannot answer.
    """
    model = sweeps[0].plan.model
    if options.calibration is not None:
        raise ConfigError(
            f"--calibration: model {model} is identified from converted values",
            hint="leave it out; docs/recordings.md shows how to replay raw counts",
        )
    for sweep in sweeps:
        if not sweep.trials:
            raise DataError(
                f"{sweep.path} has no complete trial",
                hint=f"`rigd run --resume {quote(str(sweep.path))}` plays the missing ones",
            )
    sections = []
    recordings = []
    for label, trials in groups(sweeps, by_recording=options.by_recording).items():
        tell(f"{label}: {len(trials)} complete {'trial' if len(trials) == 1 else 'trials'}")
        result = identify(trials, starts=options.starts, seed=options.seed, robust=options.robust)
        recordings.append(tuple(dict.fromkeys(sweep.path for sweep, _ in trials)))
        sweep, first = trials[0]
        reference, source = sweep.reference(first), sweep.plan.reference_label
        if not reference:
            sections.append(ReportSection(label, result))
            continue
        curve = draw_reference(source, reference, result)
        sections.append(ReportSection(label, result, reference, source, curve))
    titles = dict.fromkeys(section.result.title for section in sections)
    loss = "Huber" if options.robust else "least squares"
    origin = provenance(
        sweeps,
        [_used(sweep, sections) for sweep in sweeps],
        {"starts": str(options.starts), "seed": str(options.seed), "loss": loss},
        [_bridged_facts(sweep) for sweep in sweeps],
    )
    return ParameterEvaluation(", ".join(titles), tuple(sections), tuple(recordings), origin)


def _used(sweep: RecordedSweep, sections: Sequence[ReportSection]) -> int:
    """Return how many trials of ``sweep`` entered a fit."""
    fits = [one for section in sections for one in section.result.trials]
    return sum(one.recording == str(sweep.path) for one in fits)


def groups(
    sweeps: Sequence[RecordedSweep], *, by_recording: bool = False
) -> dict[str, list[tuple[RecordedSweep, TrialInfo]]]:
    """Return the trials by what `group_by` says of them; all under one label without it.

    ``by_recording`` tells the recordings apart as well.
    """
    found: dict[str, list[tuple[RecordedSweep, TrialInfo]]] = {}
    for sweep in sweeps:
        for trial in sweep.trials:
            words = [sweep.parameter(trial, name) for name in sweep.plan.group_by]
            words += [str(sweep.path)] if by_recording else []
            label = ", ".join(words) or sweep.info.procedure
            found.setdefault(label, []).append((sweep, trial))
    return found


def _bridged_facts(sweep: RecordedSweep) -> dict[str, str]:
    """Return what there is to say of missing and late samples; nothing where there are none."""
    count = sum(sweep.bridged(trial) for trial in sweep.trials)
    return {"samples that were missing or late, and bridged": str(count)} if count else {}
