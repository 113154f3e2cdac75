"""Reduces rows to points for a plot: the smallest and the largest value of each interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from rigd.engine.sink import Rows
from rigd.model.channels import Stream
from rigd.model.rows import TIME_FIELD

#: Bytes before the values of a row: its time (:func:`rigd.model.rows.row_dtype`).
_VALUES_AT: Final = 8


@dataclass(frozen=True, eq=False)
class Points:
    """Points of a stream of c channels, in time order.

    ``times_ns`` int64 (points,) is Unix time: that of the last row that a point represents. ``low``
    and ``high`` float64 (points, c) bound all those rows in SI units; NaN if all of them are NaN.
    """

    times_ns: NDArray[np.int64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]

    @classmethod
    def of(cls, stream: Stream, rows: Rows) -> Self:
        """Return each of ``rows`` (at least one row) as a point; the status word is left out."""
        shape = (len(rows), len(stream.channels))
        values = np.ndarray(
            shape, "<f8", np.ascontiguousarray(rows), _VALUES_AT, (rows.itemsize, 8)
        )
        values = values.copy()  # aligned, and free of the rows
        return cls(rows[TIME_FIELD].copy(), values, values)

    @classmethod
    def joined(cls, several: Sequence[Points]) -> Self:
        """Return the points of ``several`` (at least one item), one after the other."""
        return cls(
            np.concatenate([item.times_ns for item in several]),
            np.concatenate([item.low for item in several]),
            np.concatenate([item.high for item in several]),
        )

    def __len__(self) -> int:
        return len(self.times_ns)

    def reduced(self, most: int) -> Points:
        """Return at most ``most`` (2 or more) points that bound the same values.

        The last point is not merged, so that it still represents only the newest row.
        """
        count = len(self)
        if count <= most:
            return self
        starts = np.arange(most) * (count - 1) // (most - 1)
        ends = np.append(starts[1:], count) - 1
        return Points(
            self.times_ns[ends],
            np.fmin.reduceat(self.low, starts),
            np.fmax.reduceat(self.high, starts),
        )
