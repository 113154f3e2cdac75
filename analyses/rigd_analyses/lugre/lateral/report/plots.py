"""Plots carriage speeds, measured and modelled, and the load that the lateral motion gives."""

from __future__ import annotations

import math
from typing import Any, Final

from matplotlib.figure import Figure

from rigd.analysis.report.palette import FITTED, INK, MEASURED, series
from rigd.analysis.report.plots.axes import SHARED, Margins, few_ticks, grid, label
from rigd.analysis.report.trace import thin
from rigd_analyses.lugre.lateral.result import LateralResult

COLUMNS = 4  #: lateral speeds beside one another
POINTS = 80  #: of a trace: an axis is a quarter of a page wide
# Any: matplotlib's keywords have a type each.
IGNORED: Final[dict[str, Any]] = {
    "color": series(0), "linewidth": 1.0, "linestyle": (0, (4, 2)),
}  # fmt: skip
INCLUDED: Final[dict[str, Any]] = {"color": FITTED, "linewidth": 1.2}


def carriage_speeds(result: LateralResult, sign: float) -> Figure:
    """Return an axis for each lateral speed of one sign, with all its trials (Figs. 16 and 17)."""
    speeds = sorted(
        {c.lateral_speed_m_s for c in result.cells if c.lateral_speed_m_s * sign > 0.0}, key=abs
    )
    columns = min(COLUMNS, len(speeds))
    rows = math.ceil(len(speeds) / columns)
    figure, axes = grid(rows, columns, 11.0, SHARED.top + 2.3 * rows, margins=SHARED, share=True)
    for ax, speed in zip(axes, speeds, strict=False):
        for item, traces in zip(result.cells, result.speeds, strict=True):
            if item.lateral_speed_m_s == speed:
                t = traces.t_s - traces.t_s[0]
                ax.plot(*thin(t, traces.measured, POINTS), color=MEASURED, linewidth=1.6)
                ax.plot(*thin(t, traces.ignored, POINTS), **IGNORED)
                ax.plot(*thin(t, traces.included, POINTS), **INCLUDED)
        ax.set_title(f"{speed:+.2f} m/s")
    for ax in axes[len(speeds) :]:
        ax.remove()
    few_ticks(axes[: len(speeds)])
    axes[0].plot([], [], color=MEASURED, linewidth=1.6, label="measured")
    axes[0].plot([], [], label="lateral force ignored", **IGNORED)
    axes[0].plot([], [], label="included", **INCLUDED)
    figure.supxlabel("time since shortly before the current step [s]", fontsize=8.0, y=0.01)
    figure.supylabel("carriage speed [m/s]", fontsize=8.0, x=0.008)
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="upper right", ncols=len(names))
    return figure


def guide_forces(result: LateralResult) -> Figure:
    """Return the friction of the guide over the lateral speed: the model, and each trial."""
    figure, (ax,) = grid(1, 1, 9.0, 3.2, margins=Margins(right=2.0))
    guide = result.guide
    ax.plot(
        guide.trial_m_s, guide.trial_n, color=MEASURED, linestyle="", marker="o", markersize=4.0,
        label="each trial",
    )  # fmt: skip
    ax.axhline(guide.straight_n, label="lateral force ignored", **IGNORED)
    ax.plot(guide.speed_m_s, guide.force_n, label="included", **INCLUDED)
    ax.axvline(0.0, color=INK, linewidth=0.6)
    label(ax, "lateral speed v_z", "m/s", "friction of the guide", "N")
    ax.set_ylim(bottom=0.0)
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    return figure
