"""Evaluates lateral sweeps: the rollers' friction of each group, and the speeds that follow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rigd.analysis import Options
from rigd.analysis.parameters import (
    Fitted,
    Group,
    ParameterEvaluation,
    complete_groups,
    each_group,
)
from rigd.analysis.recordings.source import RecordedSweep
from rigd.analysis.report import ReportSection
from rigd.analysis.terminal import TerminalReport
from rigd.analysis.validation.saved_models import read_models
from rigd_analyses.lugre.lateral.reading import identify
from rigd_analyses.lugre.lateral.report.tables import speed_error_tables
from rigd_analyses.lugre.lateral.result import LateralResult
from rigd_analyses.lugre.lateral.saved_friction import carried


@dataclass(frozen=True)
class LateralEvaluation(ParameterEvaluation):
    """The results of all groups, each with its speed errors beside the paper's."""

    def report(self) -> str:
        """Return the report as a self-contained HTML page; 8 s for 32 trials."""
        # Here, so that a command that only names this module does not wait for matplotlib.
        from rigd.analysis.report.page import render
        from rigd_analyses.lugre.lateral.report.view import TEMPLATES, build_lateral_view

        return render(
            "lateral.html.jinja",
            lambda: build_lateral_view(self.sections, lateral(self.sections)),
            self.provenance,
            self.title,
            TEMPLATES,
            self.opening,
        )

    def terminal_report(self) -> TerminalReport:
        """Return the parameters, the speed errors of each group, and the advice below."""
        parameters, *paragraphs = super().terminal_report()
        tables = [
            table
            for section, item in zip(self.sections, lateral(self.sections), strict=True)
            for table in speed_error_tables(item, section.label if len(self.sections) > 1 else "")
        ]
        return (parameters, *tables, *paragraphs)


def lateral(sections: Sequence[ReportSection]) -> list[LateralResult]:
    """Return the results of ``sections``, which are all of lateral sweeps."""
    return [item.result for item in sections if isinstance(item.result, LateralResult)]


def evaluate(
    sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
) -> ParameterEvaluation:
    """Return the rollers' friction of each group of trials.

    Raises:
        ConfigError: the model that is to give the friction along the guide cannot do so.
        DataError: a recording has no complete trial, or the data of no group can answer.
    """
    models = () if options.model is None else read_models(options.model)

    def identified(group: Group) -> LateralResult:
        friction = carried(models, group.conditions, group.rigs) if models else None
        return identify(group.trials, friction)

    found, refused = each_group(
        complete_groups(sweeps, options, notify), identified, options.processes
    )
    fitted = [Fitted(group, result) for group, result in found]
    return LateralEvaluation.of(sweeps, fitted, options, refused=refused)
