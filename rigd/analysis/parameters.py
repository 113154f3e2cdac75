"""Evaluates recordings by fitting a model: parameters with intervals, for each group of trials."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from shlex import quote
from typing import Final, TypeVar

from rigd.analysis.analysis import Evaluation, Options
from rigd.analysis.estimates import Estimate
from rigd.analysis.joint_account import JointAccount
from rigd.analysis.measures.ranges import changed_formula
from rigd.analysis.measures.recordings import formulas_behind
from rigd.analysis.plain_data import plain_object
from rigd.analysis.provenance import file_sha256, provenance
from rigd.analysis.recordings.source import RecordedSweep
from rigd.analysis.report import (
    Facts,
    Heading,
    Opening,
    Provenance,
    ReferenceCurve,
    ReportSection,
    SummaryRow,
    summary_rows,
)
from rigd.analysis.report.opening import opening_of
from rigd.analysis.report.tables.models import HEADS, model_rows
from rigd.analysis.result import Curve, FitOutcome, IdentificationResult, Verdict
from rigd.analysis.side_by_side import side_by_side
from rigd.analysis.terminal import Column, TableRow, TerminalReport, TerminalTable
from rigd.model.errors import DataError
from rigd.record import TrialInfo

#: What the verdict adds, given once below the table instead of in every row.
FROM_HERE: Final = " from this excitation"

CROWD: Final = 2  #: groups at once for each process that the machine has use for

Trials = Sequence[tuple[RecordedSweep, TrialInfo]]
T = TypeVar("T")


@dataclass(frozen=True)
class Group:
    """Trials that are fitted together, under the label that `group_by` gives them."""

    label: str
    trials: Trials
    pooled: tuple[str, ...] = ()  #: named by `group_by`, but not separating groups

    @property
    def recordings(self) -> tuple[Path, ...]:
        """The files that the trials are from, in the order recorded."""
        return tuple(dict.fromkeys(sweep.path for sweep, _ in self.trials))

    @property
    def rigs(self) -> tuple[str, ...]:
        """The rigs that recorded the trials, by name."""
        return tuple(sorted({sweep.info.rig for sweep, _ in self.trials}))

    @property
    def conditions(self) -> dict[str, str]:
        """What `group_by` names, with the values that the trials have in common."""
        found = conditions(*self.trials[0])
        return {name: value for name, value in found.items() if name not in self.pooled}

    @property
    def reference(self) -> dict[str, float]:
        """The published values that belong to the first trial; empty if the plan has none."""
        sweep, first = self.trials[0]
        return sweep.reference(first)

    @property
    def reference_label(self) -> str:
        """Origin of the published values."""
        return self.trials[0][0].plan.reference_label


@dataclass(frozen=True)
class RefusedGroup:
    """A group whose data cannot answer: its files, the reason, and what to do about it."""

    group: str
    recordings: tuple[str, ...]
    reason: str
    hint: str

    @staticmethod
    def of(group: Group, error: DataError) -> RefusedGroup:
        """Return ``group``, which ``error`` refuses."""
        files = tuple(str(path) for path in group.recordings)
        return RefusedGroup(group.label, files, error.message, error.hint or "")

    @property
    def sentence(self) -> str:
        """The group, its files if the reason does not name them, and the reason."""
        named = any(path in self.reason or path in self.group for path in self.recordings)
        files = "" if named else f" ({', '.join(self.recordings)})"
        return f"{self.group}{files}: {self.reason}"


@dataclass(frozen=True)
class Fitted:
    """A group with its result, and the curve of its published values if there are any."""

    group: Group
    result: IdentificationResult
    reference_curve: ReferenceCurve | None = None

    @property
    def section(self) -> ReportSection:
        """The part of the report on this group."""
        group = self.group
        if not group.reference:
            return ReportSection(group.label, self.result)
        return ReportSection(
            group.label, self.result, group.reference, group.reference_label, self.reference_curve
        )


@dataclass(frozen=True)
class ParameterEvaluation(Evaluation):
    """The results of all groups in the order of the recordings, and the origin of the data."""

    title: str
    sections: tuple[ReportSection, ...]
    recordings: tuple[tuple[Path, ...], ...]  #: those of each section
    provenance: Provenance
    conditions: tuple[Mapping[str, str], ...] = ()  #: of each section, as `group_by` names them
    rigs: tuple[tuple[str, ...], ...] = ()  #: those that recorded each section
    joint: JointAccount | None = None  #: of groups that share constants
    refused: tuple[RefusedGroup, ...] = ()
    processes: int = 1  #: that may draw the report side by side

    @property
    def fits(self) -> bool:
        """Whether the model fits in all groups, as far as its method can judge; none is refused."""
        gates = [section.result.gate for section in self.sections]
        fit = all(gate is None or gate.outcome is not FitOutcome.MISFIT for gate in gates)
        return fit and not self.refused

    @property
    def opening(self) -> Opening:
        """What of the parameters and curves may be used, and what may not."""
        return opening_of(self.sections)

    @property
    def heading(self) -> Heading:
        """Origin of the data."""
        return self.provenance.heading

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The parameters of each group, then what follows from them, as the report has them."""
        return tuple(
            item.as_estimate(section.label)
            for section in self.sections
            for item in (*section.result.parameters, *section.result.derived)
        )

    @property
    def curves(self) -> Mapping[str, Curve]:
        """The curve of each group that has points."""
        found = {section.label: section.result.curve for section in self.sections}
        return {label: curve for label, curve in found.items() if curve.x.size}

    @classmethod
    def of(
        cls,
        sweeps: Sequence[RecordedSweep],
        fitted: Sequence[Fitted],
        options: Options,
        joint: JointAccount | None = None,
        refused: Sequence[RefusedGroup] = (),
        bridged: bool = True,
    ) -> ParameterEvaluation:
        """Return the evaluation of ``sweeps`` from the results of all their groups.

        ``bridged``: it is of samples at even times (:meth:`.RecordedSweep.signals`).
        """
        sections = tuple(item.section for item in fitted)
        loss = "Huber" if options.robust else "least squares"
        origin = provenance(
            sweeps,
            [_used(sweep, sections) for sweep in sweeps],
            {"starts": str(options.starts), "seed": str(options.seed), "loss": loss},
            [_bridged_facts(sweep) if bridged else {} for sweep in sweeps],
        )
        if joint is not None and joint.constants:
            entries = {item.wording: item.text for item in joint.constants.values()}
            facts = Facts(joint.title.capitalize(), entries)
            origin = replace(origin, facts=(*origin.facts, facts))
        if refused:
            entries = {item.group: f"{item.sentence}. {item.hint}" for item in refused}
            origin = replace(origin, facts=(*origin.facts, Facts("Not identified", entries)))
        titles = dict.fromkeys(item.result.title for item in fitted)
        recordings = tuple(item.group.recordings for item in fitted)
        values = tuple(item.group.conditions for item in fitted)
        rigs = tuple(item.group.rigs for item in fitted)
        return cls(
            ", ".join(titles), sections, recordings, origin, values, rigs, joint, tuple(refused),
            options.processes,
        )  # fmt: skip

    def report(self) -> str:
        """Return the report as a self-contained HTML page; 3 s of CPU for a group of ten trials.

        Raises:
            ValueError: no sections, or two with the same label.
        """
        # Here, so that a command that only names this module does not wait for matplotlib.
        from rigd.analysis.report.page import render
        from rigd.analysis.report.view import build_view

        return render(
            "report.html.jinja", lambda: build_view(self.sections, self.processes),
            self.provenance, self.title, opening=self.opening,
        )  # fmt: skip

    def to_json(self) -> dict[str, object]:
        """Return the results as an object for ``json.dumps``.

        Of a single group it is the group's own object (``parameters``, ``friction_curve``, …)
        with ``group`` and ``recordings``; of several, ``groups`` is a list of such objects, and
        ``refused`` a list of those whose data cannot answer.
        """
        groups = [
            {
                "group": section.label,
                "conditions": dict(values),
                "recordings": [str(path) for path in paths],
                "recordings_sha256": [file_sha256(path) for path in paths],
                "rigs": list(rigs),
                **section.result.to_json(),
            }
            for section, paths, values, rigs in zip(
                self.sections, self.recordings, self.conditions, self.rigs, strict=True
            )
        ]
        alone = len(groups) == 1 and not self.refused
        found: dict[str, object] = groups[0] if alone else {"groups": groups}
        if self.refused:
            found["refused"] = [plain_object(item) for item in self.refused]
        return found if self.joint is None else {**found, "joint": plain_object(self.joint)}

    def terminal_report(self) -> TerminalReport:
        """Return one table of all groups, and the advice below it."""
        rows = summary_rows(self.sections)
        paragraphs: list[TerminalTable | str] = []
        if any(row.verdict is Verdict.UNIDENTIFIABLE for row in rows):
            paragraphs.append(
                f"not identifiable:{FROM_HERE}; no number is printed for what is not known"
            )
        advised: dict[str, list[str]] = {}
        for row in rows:
            # The first sentence is the advice; the report has the rest.
            if row.advice:
                first = row.advice.partition(". ")[0].rstrip(".")
                advised.setdefault(first, []).append(f"{row.name} ({row.section})")
        if advised:
            lines = [f"  {', '.join(names)}: {advice}." for advice, names in advised.items()]
            paragraphs.append("\n".join(["what would help:", *lines]))
        for section in self.sections:
            used, left_out = len(section.result.trials), section.result.preprocessing.rejected
            lines = [f"{section.label}: {used} of {used + len(left_out)} trials used"]
            if account := section.result.preprocessing.rows_in_words:
                lines.append(f"  {account}")
            lines += [f"  {warning}" for warning in section.result.warnings]
            paragraphs.append("\n".join(lines))
        paragraphs += [
            f"not identified: {item.sentence}\n  {item.hint}".rstrip() for item in self.refused
        ]
        if self.joint is not None:
            paragraphs += _shared(self.joint)
        for section in self.sections:
            paragraphs += _comparison(section)
        return (self._table(rows), *paragraphs)

    def _table(self, rows: Sequence[SummaryRow]) -> TerminalTable:
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
            found.append(TableRow(cells, faint=not row.known))
            last = row.section
        return TerminalTable(tuple(columns), tuple(found))


def _shared(joint: JointAccount) -> TerminalReport:
    """Return the constants that groups share, and what is said of the joint fit."""
    said = "\n".join(joint.sentences)
    if not joint.constants:
        return (said,) if said else ()
    rows = tuple(
        TableRow(
            (
                item.wording, f"{item.stated:.5g} ± {item.stated_u:.2g}",
                f"{item.value:.5g} ± {item.u:.2g}", item.unit,
            )
        )
        for item in joint.constants.values()
    )  # fmt: skip
    heads = (Column("constant"), Column("stated", right=True), Column("fitted", right=True))
    return (TerminalTable((*heads, Column("unit")), rows, joint.title), said)


def _comparison(section: ReportSection) -> TerminalReport:
    """Return which models the data of ``section`` support; nothing if none were compared."""
    found = section.result.comparison
    if found is None:
        return ()
    heads = (Column("model"), *(Column(head, right=bool(head)) for head in HEADS))
    rows = tuple(TableRow(row.cells, faint=not row.fits) for row in model_rows(found))
    return (
        TerminalTable(heads, rows, f"{section.label}: models compared"),
        "\n".join(found.sentences),
    )


def complete_groups(
    sweeps: Sequence[RecordedSweep],
    options: Options,
    notify: Callable[[str], None],
    pooled: Sequence[str] = (),
) -> Iterator[Group]:
    """Yield the complete trials, group by group; ``notify`` gets a line on each as it is yielded.

    ``pooled`` names parameters that do not separate groups, although `group_by` names them.

    Raises:
        DataError: a recording has no complete trial, or a group is of several rigs, or of signals
            from derived channels with several formulas.
    """
    for sweep in sweeps:
        if not sweep.trials:
            raise DataError(
                f"{sweep.path} has no complete trial",
                hint=f"`rigd run --resume {quote(str(sweep.path))}` plays the missing ones",
            )
    found = groups(sweeps, by_recording=options.by_recording, pooled=pooled)
    for label, trials in found.items():
        _refuse_different_rigs(trials)
        _refuse_different_formulas(trials)
        notify(f"{label}: {len(trials)} complete {'trial' if len(trials) == 1 else 'trials'}")
        yield Group(label, trials, tuple(pooled))


def each_group(
    groups: Iterable[Group], evaluated: Callable[[Group], T], processes: int = 1
) -> tuple[list[tuple[Group, T]], list[RefusedGroup]]:
    """Return what ``evaluated`` makes of each group, and the groups whose data cannot answer.

    With one process all are evaluated here; with more, at most ``CROWD`` times as many groups at
    once: one that begins when the others end would leave processors without work.

    Raises:
        DataError: that is so of all groups; with the reason of the first.
    """

    def answered(group: Group) -> T | DataError:
        try:
            return evaluated(group)
        except DataError as error:
            return error

    all_groups = list(groups)
    at_once = processes if processes < 2 else CROWD * processes
    answers = side_by_side([partial(answered, group) for group in all_groups], at_once)
    found: list[tuple[Group, T]] = []
    refused: list[RefusedGroup] = []
    for group, answer in zip(all_groups, answers, strict=True):
        if isinstance(answer, DataError):
            last = answer
            refused.append(RefusedGroup.of(group, answer))
        else:
            found.append((group, answer))
    if refused and not found:
        if len(refused) == 1 and len(refused[0].recordings) == 1:
            raise last
        others = [f"; also {item.sentence}" for item in refused[1:]]
        raise DataError("".join([refused[0].sentence, *others]), hint=refused[0].hint or None)
    return found, refused


def conditions(sweep: RecordedSweep, trial: TrialInfo) -> dict[str, str]:
    """Return what `group_by` names, as a person writes it, with the values of ``trial``.

    Raises:
        DataError: neither the trial nor the run has one of them.
    """
    return {name: sweep.parameter(trial, name) for name in sweep.plan.group_by}


def _used(sweep: RecordedSweep, sections: Sequence[ReportSection]) -> int:
    """Return how many trials of ``sweep`` entered a fit."""
    fits = [trial for section in sections for trial in section.result.trials]
    return sum(fit.recording == str(sweep.path) for fit in fits)


def groups(
    sweeps: Sequence[RecordedSweep], *, by_recording: bool = False, pooled: Sequence[str] = ()
) -> dict[str, list[tuple[RecordedSweep, TrialInfo]]]:
    """Return the trials by their values of `group_by`; all under one label without it.

    Those of a group are in the order in which they were played, recording by recording, so that a
    trend over them is one over time. ``by_recording`` separates the recordings as well; what
    ``pooled`` names does not separate.
    """
    found: dict[str, list[tuple[RecordedSweep, TrialInfo]]] = {}
    for sweep in sweeps:
        for trial in sweep.trials:
            named = conditions(sweep, trial)
            words = [value for name, value in named.items() if name not in pooled]
            words += [str(sweep.path)] if by_recording else []
            label = ", ".join(words) or sweep.info.procedure
            found.setdefault(label, []).append((sweep, trial))
    return {label: sorted(trials, key=_played) for label, trials in found.items()}


def _refuse_different_rigs(trials: Trials) -> None:
    """Refuse trials of different rigs: one fit of them is of neither.

    Raises:
        DataError: there are two.
    """
    first = trials[0][0]
    for sweep, _ in trials:
        if sweep.info.rig != first.info.rig:
            raise DataError(
                f"{sweep.path} is of the rig {sweep.info.rig!r}, {first.path} of the rig "
                f"{first.info.rig!r}",
                hint="identify the recordings of each rig by themselves, with a command each or "
                "with `--group-by recording`",
            )


def _refuse_different_formulas(trials: Trials) -> None:
    """Refuse trials with a signal that two formulas derive: one fit of them is of neither.

    Raises:
        DataError: there are two.
    """
    sweeps = {sweep.path: sweep for sweep, _ in trials}.values()
    known = [
        (sweep.path, formulas_behind(sweep.recording, sweep.plan.signals.values()))
        for sweep in sweeps
    ]
    for (first, mine), (second, theirs) in combinations(known, 2):
        channel = changed_formula(mine, theirs)
        if channel is not None:
            raise DataError(
                f"signals rest on {channel}, which is {mine[channel]!r} in {first} and "
                f"{theirs[channel]!r} in {second}",
                hint="identify the recordings of each formula by themselves, with a command each "
                "or with `--group-by recording`",
            )


def _played(trial: tuple[RecordedSweep, TrialInfo]) -> tuple[int, int]:
    """Return when the recording of ``trial`` began, and when the trial did."""
    return trial[0].info.start_ns, trial[1].start_ns


def _bridged_facts(sweep: RecordedSweep) -> dict[str, str]:
    """Return a note on missing and late samples; nothing if there are none."""
    count = sum(sweep.bridged(trial) for trial in sweep.trials)
    return {"samples that were missing or late, and bridged": str(count)} if count else {}
