"""Prints a renewed calibration, or returns it as JSON."""

from __future__ import annotations

import math
from typing import Final

from rigd.analysis.calibration.evaluation import CalibrationEvaluation
from rigd.analysis.report.rounding import number, percent, places_for
from rigd.analysis.terminal import Column, TableRow, TerminalTable
from rigd.cli.evaluation_view import print_terminal_report
from rigd.daemon.calibrate import Renewal

#: A change of more standard uncertainties than this is not chance.
_FAR: Final = 3.0


def print_renewal(evaluation: CalibrationEvaluation, planned: Renewal) -> None:
    """Print the measured values and their budget, then new values beside old."""
    print_terminal_report((*evaluation.findings(), _table(planned), *_remarks(planned)))


def renewal_json(
    evaluation: CalibrationEvaluation, planned: Renewal, *, written: bool
) -> dict[str, object]:
    """Return the evaluation, and the written values and file, as an object for ``json.dumps``."""
    deviations = {name: planned.deviation(name) for name in planned.measured}
    return {
        **evaluation.to_json(),
        "written": str(planned.new.path) if written else None,
        "sha256": planned.new.sha256 if written else None,
        "deviation": {k: v for k, v in deviations.items() if not math.isnan(v)},
    }


def _table(planned: Renewal) -> TerminalTable:
    rows = []
    for name in planned.measured:
        now = planned.new.values[name]
        was = planned.was(name)
        cells = [name, _spread(now.value, now.u), now.unit]
        if was is None:
            cells += ["none", "", "", ""]
        else:
            change = percent(now.value / was.value - 1.0) if was.value else ""
            cells += [
                _spread(was.value, was.u),
                was.source,
                change,
                f"{planned.deviation(name):+.1f}".replace("-", "\N{MINUS SIGN}"),
            ]
        rows.append(TableRow(tuple(cells)))
    columns = (
        Column("value"),
        Column("new ± u", right=True),
        Column("unit"),
        Column("old ± u", right=True),
        Column(""),
        Column("change", right=True),
        Column("(new - old)/u", right=True),
    )
    return TerminalTable(columns, tuple(rows), "new values beside old")


def _remarks(planned: Renewal) -> list[str]:
    remarks = []
    if far := [name for name in planned.measured if abs(planned.deviation(name)) > _FAR]:
        remarks.append(
            f"{', '.join(far)}: more than {_FAR:g} u from the old value. The rig has changed, "
            "or one of the two values is wrong."
        )
    if late := [name for name in planned.measured if planned.is_older(name)]:
        remarks.append(
            f"{', '.join(late)}: the new value was measured before the value that it replaces."
        )
    return remarks


def _spread(value: float, u: float) -> str:
    places = places_for(u)
    return f"{number(value, places)} ± {number(u, places)}"
