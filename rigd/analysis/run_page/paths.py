"""Takes the paths of bodies in a plane from rows, with a break wherever a line would mislead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.result import BoolArray, FloatArray
from rigd.model.poses import Pose
from rigd.model.rows import TIME_FIELD

#: A number beyond it, such as the largest float64, says that there is no value; matplotlib cannot
#: draw it.
LARGEST: Final = 1e300
#: A body counts as lost after so many s without a pose; a slow one after so many usual intervals.
LOST_S: Final = 0.5
LOST_INTERVALS: Final = 4.0
#: A step so many times as long as those beside it, and longer than this share of the path's
#: extent, is a body that was put elsewhere.
JUMP: Final = 10.0
JUMP_SHARE: Final = 0.02


@dataclass(frozen=True, eq=False)
class BodyPath:
    """The path of a body: x and y (n,) in m, NaN where it is interrupted; the last heading in rad.

    The heading is None if it is not measured.
    """

    x: FloatArray
    y: FloatArray
    heading: float | None

    def then(self, later: BodyPath) -> BodyPath:
        """Return this path and ``later`` as one."""
        return BodyPath(
            np.concatenate([self.x, later.x]), np.concatenate([self.y, later.y]), later.heading
        )


def path_of(pose: Pose, rows: NDArray[np.void], points: int) -> BodyPath | None:
    """Return the path of a body in ``rows`` (n,) of its stream, in about ``points`` points.

    None if no row has a position.
    """
    x, y = (np.asarray(rows[name], dtype=np.float64) for name in (pose.x, pose.y))
    seen = (np.abs(x) < LARGEST) & (np.abs(y) < LARGEST)
    if not seen.any():
        return None
    t_s: FloatArray = rows[TIME_FIELD][seen].astype(np.float64) * 1e-9
    x, y = x[seen], y[seen]
    heading = None
    if pose.heading is not None:
        heading = float(np.asarray(rows[pose.heading], dtype=np.float64)[seen][-1])
    stretch = np.cumsum(_broken(t_s, x, y))
    kept = np.unique(np.linspace(0, x.size - 1, max(2, points)).astype(np.intp))
    breaks = np.flatnonzero(np.diff(stretch[kept])) + 1
    return BodyPath(np.insert(x[kept], breaks, np.nan), np.insert(y[kept], breaks, np.nan), heading)


def _broken(t_s: FloatArray, x: FloatArray, y: FloatArray) -> BoolArray:
    """Return for each point (n,) whether the path is interrupted before it."""
    broken = np.zeros(x.size, dtype=np.bool_)
    if x.size < 2:
        return broken
    waits, steps = np.diff(t_s), np.hypot(np.diff(x), np.diff(y))
    beside = np.maximum(np.append(0.0, steps[:-1]), np.append(steps[1:], 0.0))
    least = JUMP_SHARE * max(float(np.ptp(x)), float(np.ptp(y)))
    lost = waits > max(LOST_S, LOST_INTERVALS * float(np.median(waits)))
    broken[1:] = lost | (steps > np.maximum(JUMP * beside, least))
    return broken
