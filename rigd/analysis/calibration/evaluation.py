"""Prepares the result of a calibration for the terminal, for programs and for the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from shlex import quote

from rigd.analysis.analysis import Evaluation
from rigd.analysis.calibration.reading import Steps
from rigd.analysis.calibration.result import CalibrationResult, Measured
from rigd.analysis.estimates import Estimate
from rigd.analysis.plain_data import plain_object
from rigd.analysis.provenance import provenance
from rigd.analysis.report import Heading, Opening, Provenance
from rigd.analysis.report.opening import joined, listed
from rigd.analysis.report.rounding import number, places_for
from rigd.analysis.terminal import Column, TableRow, TerminalReport, TerminalTable
from rigd.record.read.moment import is_virtual, recorded_at


@dataclass(frozen=True)
class CalibrationEvaluation(Evaluation):
    """The values that one recording calibrates; it writes no file, ``rigd calibrate`` does."""

    title: str
    result: CalibrationResult
    recording: Path
    rig: str
    instruments: Mapping[str, str]  #: the reported identity of each device that was used
    made: date | None  #: the day it was recorded; None if that was in virtual time
    provenance: Provenance

    @property
    def opening(self) -> Opening:
        """Which values may be used, and which were refused or not measured."""
        result = self.result
        if result.refusals:
            return Opening("no value.", joined(result.refusals, ""))
        values = listed(list(result.measured))
        return Opening(
            joined([values], "no value"),
            joined(
                [f"{k}: {why}" for k, why in result.kept.items()],
                "nothing that this recording measures",
            ),
        )

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The values with value ± 2 u, and those that are not measured; no value if refused."""
        refused = " ".join(self.result.refusals)
        return (
            *(
                Estimate("", name, item.unit, None, None, None, False, "refused", refused)
                if refused
                else Estimate(
                    "", name, item.unit, item.value,
                    item.value - 2.0 * item.u, item.value + 2.0 * item.u, True, "measured",
                )
                for name, item in self.result.measured.items()
            ),
            *(
                Estimate("", name, "", None, None, None, False, "not measured", why)
                for name, why in self.result.kept.items()
            ),
        )  # fmt: skip

    @property
    def heading(self) -> Heading:
        """Origin of the data."""
        return self.provenance.heading

    def report(self) -> str:
        """Return the report as a self-contained HTML page."""
        # Here: matplotlib takes longer to import than a calibration to evaluate.
        from rigd.analysis.calibration.view import build_view
        from rigd.analysis.report.page import render

        return render(
            "calibration.html.jinja",
            lambda: build_view(self.result),
            self.provenance,
            self.title,
            opening=self.opening,
        )

    def to_json(self) -> dict[str, object]:
        """Return values in SI with their uncertainty (k = 1) and its terms, or the refusals."""
        result = self.result
        return plain_object(
            {
                "title": self.title,
                "recording": self.recording,
                "rig": self.rig,
                "instruments": self.instruments,
                "refusals": result.refusals,
                "values": result.measured,
                "kept": result.kept,
                "facts": result.facts,
            }
        )

    def terminal_report(self) -> TerminalReport:
        """Return what was found, and how it is put into the calibration."""
        command = f"rigd calibrate --from {quote(str(self.recording))} --operator NAME"
        writes = not self.result.refusals and self.result.kind == "calibration"
        write = "" if not writes else f"Nothing is written yet: {command}"
        return (*self.findings(), *([write] if write else []))

    def findings(self) -> TerminalReport:
        """Return the values with their budgets, what stays as it was, and the facts."""
        result = self.result
        if result.refusals:
            refused = [f"{result.title}: this is no {result.kind}", *_listed(result.refusals)]
            return ("\n".join(refused), *_paragraph("what was seen:", result.facts))
        return (
            _values(result.measured),
            *_paragraph("", result.facts),
            *_paragraph("not measured:", [f"{k}: {why}" for k, why in result.kept.items()]),
        )


def evaluated(steps: Steps, result: CalibrationResult) -> CalibrationEvaluation:
    """Return ``result``, found in the recording of ``steps``, with its origin."""
    sweep = steps.sweep
    return CalibrationEvaluation(
        title=f"{result.title} of {sweep.info.rig}",
        result=result,
        recording=sweep.path,
        rig=sweep.info.rig,
        instruments=steps.instruments(),
        made=None
        if is_virtual(sweep.info)  # its dates are not the operator's
        else recorded_at(sweep.info).at.date(),
        provenance=provenance([sweep], [len(sweep.trials)], {"method": sweep.plan.model}),
    )


def _values(measured: Mapping[str, Measured]) -> TerminalTable:
    rows = []
    for name, item in measured.items():
        places = places_for(item.u)
        rows.append(
            TableRow(
                (name, f"{number(item.value, places)} ± {number(item.u, places)}", item.unit, "")
            )
        )
        rows += [
            TableRow(("", number(term.u, places), "", term.name), True) for term in item.budget
        ]
    columns = (Column("value"), Column("± u (k=1)", right=True), Column("unit"), Column("from"))
    return TerminalTable(columns, tuple(rows))


def _paragraph(title: str, lines: Sequence[str]) -> list[str]:
    return ["\n".join([*([title] if title else []), *_listed(lines)])] if lines else []


def _listed(lines: Sequence[str]) -> list[str]:
    return [f"  {line}" for line in lines]
