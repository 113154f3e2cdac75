"""Plots the correlation matrix of the fitted parameters as a heat map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from rigd.analysis.report.palette import SERIES
from rigd.analysis.report.plots.axes import Margins, grid
from rigd.analysis.report.rounding import number
from rigd.analysis.result import FloatArray

#: Width of a cell in inches.
CELL = 0.55
POSITIVE, NEGATIVE = SERIES[1], SERIES[0]


def correlation(names: Sequence[str], matrix: FloatArray) -> Figure:
    """Return the (p, p) matrix: shade for strength, hue for sign, the number in each cell."""
    count = len(names)
    # The longest name sets the room: 0.065 inches a letter, turned by 35 degrees below the axis.
    letters = 0.065 * max(len(name) for name in names)
    margins = Margins(left=0.25 + letters, bottom=0.25 + 0.6 * letters, top=0.1)
    size = CELL * count
    width = size + margins.left + margins.right
    figure, (ax,) = grid(1, 1, width, size + margins.top + margins.bottom, margins=margins)
    for row in range(count):
        for column in range(count):
            value = float(matrix[row, column])
            if not np.isfinite(value):
                ax.text(column, row, "–", ha="center", va="center")
                continue
            shade = POSITIVE if value >= 0.0 else NEGATIVE
            strength = 0.75 * min(abs(value), 1.0)
            corner = (column - 0.47, row - 0.47)
            ax.add_patch(Rectangle(corner, 0.94, 0.94, facecolor=shade, alpha=strength, lw=0))
            ax.text(column, row, number(value, 2), ha="center", va="center", fontsize=7.5)
    ax.set_xlim(-0.5, count - 0.5)
    ax.set_ylim(count - 0.5, -0.5)
    ax.set_aspect("equal")
    ax.set_xticks(range(count), names, rotation=35, ha="right", rotation_mode="anchor")
    ax.set_yticks(range(count), names)
    ax.tick_params(length=0)
    ax.grid(visible=False)
    ax.spines[:].set_visible(False)
    return figure
