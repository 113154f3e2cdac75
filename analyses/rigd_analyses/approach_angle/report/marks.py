"""Defines the plot markers of runs: the shape shows whether the wheel slid, rolled, or did both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from rigd.analysis.report.palette import INK, MEASURED
from rigd_analyses.approach_angle.raw.run_data import FloatArray, Regime

SIZE: Final = 4.5

Shape = Literal["o", "^", "s", "x", "D", "."]


@dataclass(frozen=True)
class Mark:
    """A marker and its name in a legend."""

    shape: Shape
    filled: bool
    label: str


OF_REGIME: Final = {
    Regime.SLIDING: Mark("o", True, "sliding: a limit"),
    Regime.MIXED: Mark("^", True, "mixed"),
    Regime.ROLLING: Mark("s", False, "rolling: the demand, no limit"),
}
LEFT_OUT: Final = Mark("x", True, "left out")


def dots(
    ax: Axes,
    x: FloatArray | list[float],
    y: FloatArray | list[float],
    colour: str,
    mark: Mark,
    *,
    size: float = SIZE,
    label: str | None = None,
) -> None:
    """Draw points without a line."""
    ax.plot(
        x,
        y,
        linestyle="none",
        marker=mark.shape,
        markersize=size,
        color=colour,
        markerfacecolor=colour if mark.filled else "none",
        label=label,
    )


def legend_handles() -> list[Line2D]:
    """Return what a legend of all markers shows."""
    return [
        Line2D(
            [],
            [],
            linestyle="none",
            marker=mark.shape,
            markersize=SIZE,
            color=colour,
            markerfacecolor=colour if mark.filled else "none",
            label=mark.label,
        )
        for mark, colour in [*((mark, INK) for mark in OF_REGIME.values()), (LEFT_OUT, MEASURED)]
    ]
