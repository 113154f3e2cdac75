"""Builds the content of the report of lateral sweeps.

Importing this module imports matplotlib.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rigd.analysis.report import ReportSection
from rigd.analysis.report.svg import Drawing, draw
from rigd.analysis.report.view import ReportView, build_view
from rigd.analysis.terminal import TerminalTable
from rigd_analyses.lugre.lateral.report import plots
from rigd_analyses.lugre.lateral.report.tables import speed_error_tables
from rigd_analyses.lugre.lateral.result import LateralResult

TEMPLATES: Final = Path(__file__).parent / "templates"
SIGNS: Final = {"positive": 1.0, "negative": -1.0}


@dataclass(frozen=True)
class LateralChapter:
    """Tables and figures of the speeds of one group."""

    label: str
    coupling: str
    tables: tuple[TerminalTable, ...]
    drawings: tuple[Drawing, ...]


@dataclass(frozen=True)
class LateralView(ReportView):
    """The report of every fit, and the speeds of each group."""

    lateral: tuple[LateralChapter, ...]


def build_lateral_view(
    sections: Sequence[ReportSection], results: Sequence[LateralResult]
) -> LateralView:
    """Return the view of ``sections``, whose results are ``results``."""
    view = build_view(sections)
    chapters = tuple(
        LateralChapter(
            section.label, result.coupling, speed_error_tables(result, ""),
            _drawings(f"v{index}", result),
        )
        for index, (section, result) in enumerate(zip(sections, results, strict=True), start=1)
    )  # fmt: skip
    return LateralView(view.comparison, view.chapters, chapters)


def _drawings(anchor: str, result: LateralResult) -> tuple[Drawing, ...]:
    found = []
    for item in result.together:
        if item.name in SIGNS:
            alt = (
                f"Carriage speed over time in {item.trials} trials with {item.name} lateral "
                f"motion: measured, modelled without and with the lateral force. RMS error "
                f"{1e3 * item.ignored_m_s:.1f} and {1e3 * item.included_m_s:.1f} mm/s."
            )
            figure = plots.carriage_speeds(result, SIGNS[item.name])
            found.append(draw(figure, f"{anchor}-{item.name}", alt, alt))
    alt = (
        "Friction of the guide over the lateral speed. A point is the model's friction in one "
        "trial and the constant force that its speed still asks for."
    )
    found.append(draw(plots.guide_forces(result), f"{anchor}-guide", alt, alt))
    return tuple(found)
