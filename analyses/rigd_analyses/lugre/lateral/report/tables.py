"""Makes the tables of speed errors: a row for each lateral speed, as in Tables III and IV."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigd.analysis.terminal import Column, TableRow, TerminalTable
from rigd_analyses.lugre.lateral.result import LateralResult
from rigd_analyses.lugre.lateral.speeds.errors import Cell

NONE = "–"


def speed_error_tables(result: LateralResult, label: str) -> tuple[TerminalTable, TerminalTable]:
    """Return the errors of each lateral speed and current, and those of all trials together.

    All in mm/s: RMS of measured minus modelled carriage speed; in brackets the paper's.
    """
    currents = sorted({round(item.current_a, 3) for item in result.cells})
    speeds = sorted({item.lateral_speed_m_s for item in result.cells},
                    key=lambda speed: (speed < 0.0, abs(speed)))  # fmt: skip
    rows = []
    for speed in speeds:
        at = [item for item in result.cells if item.lateral_speed_m_s == speed]
        cells = [speed_error([c for c in at if round(c.current_a, 3) == i]) for i in currents]
        rows.append(TableRow((f"{speed:+.2f}", *cells)))
    of = f" of {label}" if label else ""
    each = TerminalTable(
        (Column("v_z [m/s]", right=True), *(Column(f"{i:.2f} A", right=True) for i in currents)),
        tuple(rows),
        f"speed error{of} in mm/s: lateral force ignored / included (paper: Tables III / IV)",
    )
    together = TerminalTable(
        (
            Column("lateral motion"), Column("trials", right=True), Column("ignored", right=True),
            Column("included", right=True), Column("ratio", right=True),
            Column("paper", right=True), Column("error at the end if ignored", right=True),
        ),
        tuple(
            TableRow(
                (
                    item.name, str(item.trials), millimetres(item.ignored_m_s),
                    millimetres(item.included_m_s), f"{item.ratio:.1f}",
                    NONE
                    if item.paper is None
                    else f"{millimetres(item.paper.ignored_m_s)} / "
                    f"{millimetres(item.paper.included_m_s)} = {item.paper.ratio:.2f}",
                    f"{1e3 * item.error_ignored_m_s:+.1f}",
                )
            )
            for item in result.together
        ),
        "together in mm/s: root mean square over trials",
    )  # fmt: skip
    return each, together


def speed_error(cells: Sequence[Cell]) -> str:
    """Return the errors at one lateral speed and current, as ``35.1 / 0.9 (45 / 21)``."""
    if not cells:
        return NONE
    ignored = float(np.sqrt(np.mean([item.ignored_m_s**2 for item in cells])))
    included = float(np.sqrt(np.mean([item.included_m_s**2 for item in cells])))
    text = f"{millimetres(ignored)} / {millimetres(included)}"
    paper = cells[0].published
    if paper is None:
        return text
    return f"{text} ({1e3 * paper.ignored_m_s:.0f} / {1e3 * paper.included_m_s:.0f})"


def millimetres(speed_m_s: float) -> str:
    """Return a speed in mm/s as text, a tenth at the finest."""
    return f"{1e3 * speed_m_s:.1f}"
