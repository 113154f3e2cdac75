"""Builds the content of a calibration report: values, their budgets, every point beside its fit.

Importing this module imports matplotlib.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Final

from rigd.analysis.calibration.result import CalibrationResult
from rigd.analysis.report.palette import FITTED, MEASURED
from rigd.analysis.report.plots.axes import grid
from rigd.analysis.report.rounding import number, places_for
from rigd.analysis.report.svg import Drawing, draw

_COLUMNS: Final = 3
_ROW_INCHES: Final = 2.4
#: Up to so many points each is drawn as a dot of its own.
_FEW: Final = 60


@dataclass(frozen=True)
class ValueRow:
    """A value as text, with the terms of its uncertainty."""

    name: str
    value: str
    unit: str
    terms: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class CalibrationView:
    """The content that the template shows."""

    result: CalibrationResult
    rows: tuple[ValueRow, ...]
    drawing: Drawing | None


def build_view(result: CalibrationResult) -> CalibrationView:
    """Return what the template shows of ``result``, for :func:`..page.render`."""
    return CalibrationView(result, _rows(result), _drawing(result))


def _rows(result: CalibrationResult) -> tuple[ValueRow, ...]:
    rows = []
    for name, item in result.measured.items():
        places = places_for(item.u)
        terms = tuple((term.name, number(term.u, digits=2)) for term in item.budget)
        text = f"{number(item.value, places)} ± {number(item.u, places)}"
        rows.append(ValueRow(name, text, item.unit, terms))
    return tuple(rows)


def _drawing(result: CalibrationResult) -> Drawing | None:
    """Return every series with its fit: residuals are what a person must see."""
    if not result.series:
        return None
    columns = min(_COLUMNS, len(result.series))
    rows = ceil(len(result.series) / columns)
    figure, axes = grid(rows, columns, 3.7 * columns, _ROW_INCHES * rows)
    for ax, item in zip(axes, result.series, strict=False):
        few = len(item.x) <= _FEW
        ax.plot(item.x, item.fitted, color=FITTED, linewidth=1.4)
        ax.plot(
            item.x, item.y, color=MEASURED, marker="o" if few else "", markersize=4,
            linestyle="" if few else "-", linewidth=0.8,
        )  # fmt: skip
        ax.set_title(item.title)
        ax.set_xlabel(item.x_label)
        ax.set_ylabel(item.y_label)
    for ax in axes[len(result.series) :]:
        ax.set_visible(False)
    alt = f"{result.title}: what was measured beside what was fitted"
    return draw(figure, "calibration", alt, "Measured in grey, fitted in colour.")
