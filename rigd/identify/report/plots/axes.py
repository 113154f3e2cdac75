"""Figures and axes as this report uses them: labelled with units, laid out in one pass."""

from __future__ import annotations

from collections.abc import Iterable

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from rigd.identify.report.palette import MEASURED
from rigd.identify.report.rounding import number
from rigd.identify.report.trace import spans
from rigd.identify.result import BoolArray, FloatArray


def grid(
    rows: int, columns: int, width: float, height: float, *, share: bool = False
) -> tuple[Figure, list[Axes]]:
    """Return a figure of ``width`` x ``height`` inches and its axes, row by row."""
    figure = Figure(figsize=(width, height), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.03, h_pad=0.03)  # type: ignore[union-attr]
    axes = figure.subplots(rows, columns, sharex=share, sharey=share, squeeze=False)
    return figure, [ax for row in axes for ax in row]


def label(ax: Axes, x: str, x_unit: str, y: str, y_unit: str) -> None:
    """Name both axes with their units."""
    ax.set_xlabel(with_unit(x, x_unit))
    ax.set_ylabel(with_unit(y, y_unit))


def with_unit(name: str, unit: str) -> str:
    """Return ``name [unit]``, with a dash for a quantity without a dimension."""
    return f"{words(name)} [{unit_text(unit)}]"


def unit_text(unit: str) -> str:
    """Return a unit to print; ``1`` and nothing are a dash."""
    return unit if unit not in ("", "1", "-") else "–"


def words(name: str) -> str:
    """Return a name from a program as words."""
    return name.replace("_", " ")


def plain_log(ax: Axes, which: str) -> None:
    """Make an axis logarithmic with plain numbers at the decades."""
    (ax.set_xscale if which == "x" else ax.set_yscale)("log")
    axis = ax.xaxis if which == "x" else ax.yaxis
    axis.set_major_locator(LogLocator(base=10.0, numticks=7))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def few_ticks(axes: Iterable[Axes], x: int = 5, y: int = 4) -> None:
    """Limit the ticks of small axes so that their labels do not touch."""
    for ax in axes:
        ax.xaxis.set_major_locator(MaxNLocator(x))
        ax.yaxis.set_major_locator(MaxNLocator(y))


def shade_unused(ax: Axes, t: FloatArray, used: BoolArray) -> None:
    """Shade the stretches of time whose samples did not enter the fit."""
    for start, length in spans(t, ~used):
        ax.axvspan(start, start + length, color=MEASURED, alpha=0.16, linewidth=0)


def digits(value: float | None) -> str:
    """Return a number of three digits for a caption."""
    return "open" if value is None else number(value)
