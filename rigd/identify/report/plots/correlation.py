"""The correlation matrix of the fitted parameters as a heat map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from rigd.identify.report.palette import SERIES
from rigd.identify.report.plots.axes import Margins, grid
from rigd.identify.report.rounding import number
from rigd.identify.result import FloatArray

POSITIVE, NEGATIVE = SERIES[1], SERIES[0]


def correlation(names: Sequence[str], matrix: FloatArray) -> Figure:
    """Return the (p, p) matrix: shade for strength, hue for sign, the number in each cell."""
    count = len(names)
    size = 1.6 + 0.52 * count
    figure, (ax,) = grid(1, 1, size + 0.4, size, margins=Margins(left=0.9, bottom=0.75, top=0.1))
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
