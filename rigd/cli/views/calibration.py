"""Prints a renewed calibration, or returns it as JSON."""

from __future__ import annotations

import math

from rigd.analysis.calibration.evaluation import CalibrationEvaluation
from rigd.analysis.report.rounding import percent
from rigd.analysis.terminal import Column, TableRow, TerminalTable
from rigd.cli.views.evaluation import print_terminal_report
from rigd.daemon.calibrate import Renewal, spread


def print_renewal(evaluation: CalibrationEvaluation, planned: Renewal) -> None:
    """Print the measured values and their budget, then new values beside old."""
    print_terminal_report((*evaluation.findings(), _table(planned), *planned.remarks()))


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
        cells = [name, spread(now), now.unit]
        if was is None:
            cells += ["none", "", "", ""]
        else:
            change = percent(now.value / was.value - 1.0) if was.value else ""
            cells += [
                spread(was),
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
