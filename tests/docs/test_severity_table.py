"""docs/procedures.md prints the table of how runs end, as the engine has it."""

from __future__ import annotations

from pathlib import Path

from rigd.model.severity import Severity, WayOut, way_out

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "procedures.md"


def cell(way: WayOut) -> str:
    plays = ", `finish` plays" if way.finishes else ""
    return f"{way.ending} ({way.state.name.lower()}, {way.exit_code.value}){plays}"


def row(severity: Severity) -> str:
    cells = [f"`{severity.word}`", cell(way_out(severity))]
    if Severity.WARN < severity < Severity.FAULT:  # what an interlock may do
        cells += [cell(way_out(severity, tripped=True, latched=latch)) for latch in (False, True)]
    return " | ".join(cells)


def test_document_shows_how_each_severity_ends_a_run() -> None:
    text = DOCUMENT.read_text()
    table = text[text.index("## How a run ends") : text.index("## A client that vanishes")]
    shown = [line.strip("| ") for line in table.splitlines() if line.startswith("| `")]
    assert shown == [row(severity) for severity in Severity if severity is not Severity.WARN]
