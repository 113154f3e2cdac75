"""Makes the figures and axes of a report: labels with units, and one layout pass per figure."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from rigd.analysis.report.palette import MEASURED
from rigd.analysis.report.trace import spans
from rigd.analysis.result import BoolArray, FloatArray

#: Ticks stand at these multiples of a power of ten.
STEPS: Final = (1, 2, 5, 10)
#: Up to so many decades, a logarithmic axis has numbers between them.
FEW_DECADES: Final = 3


@dataclass(frozen=True)
class Margins:
    """The margins of axes in inches; ``across`` and ``down`` are the gaps between them."""

    left: float = 0.74
    right: float = 0.12
    top: float = 0.24
    bottom: float = 0.45
    across: float = 0.78
    down: float = 0.66


#: For axes that share their labels.
SHARED: Final = Margins(across=0.2, down=0.28, bottom=0.5, top=0.42)


def grid(
    rows: int,
    columns: int,
    width: float,
    height: float,
    *,
    margins: Margins = Margins(),
    share: bool = False,
) -> tuple[Figure, list[Axes]]:
    """Return a figure of ``width`` x ``height`` inches and its axes, row by row.

    Ticks stand at 1, 2 and 5. The margins are fixed: measuring every label to find them would
    double the time of a report.
    """
    figure = Figure(figsize=(width, height))
    axes_width = (width - margins.left - margins.right - (columns - 1) * margins.across) / columns
    axes_height = (height - margins.top - margins.bottom - (rows - 1) * margins.down) / rows
    axes = figure.subplots(
        rows,
        columns,
        sharex=share,
        sharey=share,
        squeeze=False,
        gridspec_kw={
            "left": margins.left / width,
            "right": 1.0 - margins.right / width,
            "top": 1.0 - margins.top / height,
            "bottom": margins.bottom / height,
            "wspace": margins.across / axes_width,
            "hspace": margins.down / axes_height,
        },
    )
    found = [ax for row in axes for ax in row]
    for ax in found:
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_locator(MaxNLocator("auto", steps=STEPS))
    return figure, found


def wipe(ax: Axes) -> None:
    """Remove what is drawn on linear axes; ticks are found again for what is drawn next."""
    legend = ax.get_legend()
    for artist in [*ax.lines, *ax.collections, *([legend] if legend is not None else [])]:
        artist.remove()
    ax.relim()


def label(ax: Axes, x: str, x_unit: str, y: str, y_unit: str) -> None:
    """Name both axes with their units."""
    ax.set_xlabel(with_unit(x, x_unit))
    ax.set_ylabel(with_unit(y, y_unit))


def with_unit(name: str, unit: str) -> str:
    """Return ``name [unit]``, with a dash for a quantity without a dimension."""
    return f"{words(name)} [{unit_text(unit)}]"


def unit_text(unit: str) -> str:
    """Return a unit to print, powers raised; ``1`` and nothing are a dash."""
    return unit.replace("^2", "²").replace("^3", "³") if unit not in ("", "1", "-") else "–"


def words(name: str) -> str:
    """Return a name from a program as words; one that begins with a letter is a symbol, as V_r."""
    return name if name[1:2] in ("", "_") else name.replace("_", " ")


def plain_log(ax: Axes, which: str) -> None:
    """Make an axis logarithmic with plain numbers at the decades; of few, also at 2 and 5.

    Call it once the data are drawn: they determine the number of decades.
    """
    (ax.set_xscale if which == "x" else ax.set_yscale)("log")
    axis = ax.xaxis if which == "x" else ax.yaxis
    low, high = ax.get_xlim() if which == "x" else ax.get_ylim()
    between = (1.0, 2.0, 5.0) if high <= low * 10.0**FEW_DECADES else (1.0,)
    axis.set_major_locator(LogLocator(base=10.0, subs=between, numticks=3 * FEW_DECADES + 1))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def few_ticks(axes: Iterable[Axes], x: int = 5, y: int = 4) -> None:
    """Limit the ticks of small axes so that their labels do not touch."""
    for ax in axes:
        ax.xaxis.set_major_locator(MaxNLocator(x, steps=STEPS))
        ax.yaxis.set_major_locator(MaxNLocator(y, steps=STEPS))


def shade_unused(ax: Axes, t: FloatArray, used: BoolArray) -> None:
    """Shade the stretches of time whose samples did not enter the fit."""
    stretches = spans(t, ~used)
    if stretches:
        whole_height = ax.get_xaxis_transform()
        ax.broken_barh(
            stretches, (0.0, 1.0), transform=whole_height, color=MEASURED, alpha=0.16, linewidth=0
        )
