"""Writes every figure of a report as files: SVG and PDF to print, CSV with the data drawn.

Importing this module imports matplotlib.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import StepPatch

from rigd.analysis.report.trace import whole_traces
from rigd.analysis.result import FloatArray

HEAD: Final = ("panel", "x_axis", "y_axis", "series", "x", "y", "low", "high")
#: A date in a PDF would make two equal figures differ.
_NO_DATE: Final = {"CreationDate": None}

Row = tuple[object, ...]


@dataclass
class FigureFiles:
    """The folder of the files, and what each shows, in the order drawn."""

    folder: Path
    shown: dict[str, str] = field(default_factory=dict)

    def write(self, figure: Figure, name: str, alt: str) -> None:
        """Write ``figure`` as ``name`` with three endings; raises OSError."""
        self.shown[name] = alt
        figure.savefig(self.folder / f"{name}.svg", facecolor="white", metadata={"Date": None})
        figure.savefig(self.folder / f"{name}.pdf", facecolor="white", metadata=_NO_DATE)
        self._table(name, HEAD, list(rows_of(figure)))

    def write_index(self) -> None:
        """Write which figure shows what, as ``index.csv``; raises OSError."""
        self._table("index", ("figure", "shows"), list(self.shown.items()))

    def _table(self, name: str, head: Row, rows: list[Row]) -> None:
        with (self.folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([head, *rows])


_FILES: ContextVar[FigureFiles | None] = ContextVar("figure files", default=None)


@contextmanager
def saving_figures(folder: Path) -> Iterator[FigureFiles]:
    """Write each figure that is drawn within the block to ``folder``, with all its samples.

    Raises:
        OSError: the folder or a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = FigureFiles(folder)
    token = _FILES.set(files)
    try:
        with whole_traces():
            yield files
        files.write_index()
    finally:
        _FILES.reset(token)


def saving() -> bool:
    """Whether figures are being saved: they are then drawn one after the other."""
    return _FILES.get() is not None


def save(figure: Figure, name: str, alt: str) -> None:
    """Write ``figure`` if figures are being saved."""
    files = _FILES.get()
    if files is not None:
        files.write(figure, name, alt)


def rows_of(figure: Figure) -> Iterator[Row]:
    """Yield what is drawn in data coordinates: lines, points with bars, bands and histograms."""
    for panel, ax in enumerate(figure.axes, start=1):
        title = ax.get_title(loc="left") or ax.get_title() or str(panel)
        for series, x, y, low, high in _series(ax):
            for row in zip(x, y, low, high, strict=True):
                values = ["" if np.isnan(value) else repr(float(value)) for value in row]
                yield (title, ax.get_xlabel(), ax.get_ylabel(), series, *values)


def _series(
    ax: Axes,
) -> Iterator[tuple[str, FloatArray, FloatArray, FloatArray, FloatArray]]:
    barred: set[Line2D] = set()
    for bars in ax.containers:
        if isinstance(bars, ErrorbarContainer):
            line, caps, (segments, *_) = bars.lines
            ends = np.array([segment[:, 1] for segment in segments.get_segments()])
            barred |= {line, *caps}
            x, y = _of(line)
            yield "measured, binned", x, y, ends[:, 0], ends[:, 1]
    for k, line in enumerate(ax.get_lines(), start=1):
        if line in barred or line.get_transform() != ax.transData:
            continue  # a line across the axes is no data
        x, y = _of(line)
        name = str(line.get_label())
        nothing = np.full(len(x), np.nan)
        yield (f"line {k}" if name.startswith("_") else name), x, y, nothing, nothing
    for k, band in enumerate(ax.collections, start=1):
        if isinstance(band, PolyCollection) and band.get_transform() == ax.transData:
            for path in band.get_paths():
                x, low, high = _band(np.asarray(path.vertices, dtype=np.float64))
                yield f"band {k}", x, np.full(len(x), np.nan), low, high
    for patch in ax.patches:
        if isinstance(patch, StepPatch):
            counts, edges, _ = (np.asarray(part, dtype=np.float64) for part in patch.get_data())
            low, high = edges[:-1], edges[1:]
            middle, name = 0.5 * (low + high), "histogram, ends of each bin"
            if patch.orientation == "horizontal":  # the bins are along y
                yield name, counts, middle, low, high
            else:
                yield name, middle, counts, low, high


def _of(line: Line2D) -> tuple[FloatArray, FloatArray]:
    x, y = (np.asarray(values, dtype=np.float64) for values in line.get_data())
    return x, y


def _band(vertices: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x, least and greatest y of the outline of a band."""
    x, place = np.unique(vertices[:, 0], return_inverse=True)
    low, high = np.full(len(x), np.inf), np.full(len(x), -np.inf)
    np.minimum.at(low, place, vertices[:, 1])
    np.maximum.at(high, place, vertices[:, 1])
    return x, low, high
