"""Checks what a recording of the robot shows before, or instead of, a fit of it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.analysis import DataError
from rigd.analysis.result import FloatArray
from rigd_analyses.articulated.reading import REST_FRAMES, RobotTrial, in_succession
from rigd_analyses.articulated.system import LOCAL, RATIO, SHARED, RobotSystem, Run

EXCHANGED: Final = 0.05  #: share of a trial's frames; single ones are left out
SILENT_S: Final = 0.5  #: without a marker, from which it is reported
SEEN: Final = 0.5  #: share of frames in which each marker must be seen
MOVING_RAD_S: Final = 5.0  #: of a motor that rests
TURNED: Final = 1.0  #: rad, from which the sense is clear
#: (k_lon, k_lat) in N s/m that bound those of rubber wheels on floors, four times apart.
CORNERS: Final = ((60.0, 100.0), (60.0, 400.0), (240.0, 100.0), (240.0, 400.0))
HINGE_OFF: Final = np.radians(3.0)  #: beyond what any of these contacts gives
LATE: Final = 0.6  #: share of a trial after which the hinge has come to rest
BENT: Final = 0.2  #: rad, of a circle


def check_markers(trials: Sequence[RobotTrial], *, pulls: bool = True) -> None:
    """Check that each marker is seen at rest and often enough, and is that of its module.

    ``pulls`` is whether the first module alone drives: a robot that is pushed may fold, and then
    turns to either side.

    Raises:
        DataError: it is not, or the robot turns to the other side than its wheels.
    """
    for item in trials:
        _check_seen(item)
    _check_succession(trials)
    for ahead, (first, second) in enumerate(pairwise(trials[0].modules)):
        exchanged = [(item, _exchanged(item, ahead)) for item in trials]
        wrong = [(item, off) for item, off in exchanged if np.mean(off) > EXCHANGED]
        if not wrong:
            continue
        item, off = wrong[0]
        where = "each trial" if len(wrong) == len(trials) else f"{len(wrong)} trials"
        raise DataError(
            f"{item.label}: from {item.t_s[int(np.argmax(off))]:.1f} s on, in "
            f"{np.count_nonzero(off)} of {len(off)} frames, the {first} marker is behind the "
            f"{second} one (so in {where}): they are taken for each other",
            hint="exchange both markers' signals in the procedure (`--plan`), or record again; a "
            "marker that is turned by half a turn on its module looks the same",
        )
    if pulls:
        _check_sense(trials)


def _check_seen(item: RobotTrial) -> None:
    for place, module in enumerate(item.modules):
        seen = item.seen[:, 3 * place]
        if not np.any(seen[:REST_FRAMES]):
            problem = f"the camera does not show the {module} marker where the robot stands"
        elif np.mean(seen) < SEEN:
            problem = f"the camera shows the {module} marker in {100 * np.mean(seen):.0f} % of "
            problem += f"the frames, needs {100 * SEEN:.0f} %"
        else:
            continue
        raise DataError(f"{item.label}: {problem}", hint="`rigd report FILE` draws the recording")
    moving = np.abs(np.mean(item.speeds[: item.at[1]], axis=0)) > MOVING_RAD_S
    if np.any(moving):
        raise DataError(
            f"{item.label}: the motors turn when the camera's first frames come",
            hint="frames of the standing robot are missing: see that the camera is on before the "
            "trial",
        )


def _check_succession(trials: Sequence[RobotTrial]) -> None:
    for place, module in enumerate(trials[0].modules):
        if not any(np.any(in_succession(item.seen[:, 3 * place])) for item in trials):
            raise DataError(
                f"the camera never shows the {module} marker in three frames in succession, which "
                "the noise of its poses is taken from",
                hint="`rigd report FILE` draws the recording",
            )


def _exchanged(item: RobotTrial, ahead: int) -> NDArray[np.bool_]:
    """Return the frames (n,) in which the marker of a module is behind that of the next one."""
    first = 3 * ahead
    poses, seen = item.poses[:, first : first + 6], item.seen[:, first : first + 6]
    along = np.cos(poses[:, 2]) + np.cos(poses[:, 5]), np.sin(poses[:, 2]) + np.sin(poses[:, 5])
    apart = poses[:, 0] - poses[:, 3], poses[:, 1] - poses[:, 4]
    behind = along[0] * apart[0] + along[1] * apart[1] < 0.0
    return np.asarray(behind & seen[:, 0] & seen[:, 3], dtype=np.bool_)


def _check_sense(trials: Sequence[RobotTrial]) -> None:
    signs = []
    for item in trials:
        turned = item.poses[-1, 2] - item.standing[2]
        driven = float(np.mean(item.speeds[item.at, 0] - item.speeds[item.at, 1]))
        if abs(turned) > TURNED and abs(driven) > MOVING_RAD_S:
            signs.append(np.sign(turned * driven))
    if signs and np.mean(signs) < 0.0:
        raise DataError(
            f"in {sum(sign < 0 for sign in signs)} of {len(signs)} circles the camera shows the "
            "robot turn to the other side than its wheels",
            hint="are the right and the left motor exchanged, or headings counted clockwise?",
        )


def silences(trials: Sequence[RobotTrial]) -> list[str]:
    """Return a sentence on each marker that a trial does not show for SILENT_S or longer."""
    found = []
    for item in trials:
        for place, module in enumerate(item.modules):
            begin, count = _longest(~item.seen[:, 3 * place])
            if count * item.period_s >= SILENT_S:
                found.append(
                    f"{item.label}: the camera shows no {module} marker for "
                    f"{count * item.period_s:.1f} s, from {item.t_s[begin]:.1f} s on. These "
                    "frames do not count."
                )
    return found


def _longest(flags: NDArray[np.bool_]) -> tuple[int, int]:
    """Return where the longest run of true ``flags`` begins, and how long it is."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    if edges.size == 0:
        return 0, 0
    lengths = edges[1::2] - edges[::2]
    best = int(np.argmax(lengths))
    return int(edges[2 * best]), int(lengths[best])


def check_hinge(system: RobotSystem, grip: float) -> None:
    """Check that the hinge turns on circles as far as some contacts let it.

    Trials count in which contacts may carry at most ``grip`` times the load.

    Raises:
        DataError: in the median of these trials it turns less.
    """
    lacking, angles = [], []
    for k, item in enumerate(system.trials):
        sign, measured = _bend(item.poses - item.standing)
        late = item.t_s > LATE * item.t_s[-1]
        last = float(np.median(measured[late]))
        runs = [_simulated(system, k, *corner) for corner in CORNERS] if last > BENT else []
        if not runs or min(float(np.max(run.share)) for run in runs) > grip:
            continue
        shown = [np.median(sign * (run.pose[:, 2] - run.pose[:, 5])[late]) for run in runs]
        lacking.append(float(min(shown)) - last)
        angles.append(last)
    if not lacking or np.median(lacking) < HINGE_OFF:
        return
    raise DataError(
        f"on {len(angles)} circles the hinge turns by {np.degrees(np.median(angles)):.0f} degrees, "
        f"by {np.degrees(np.median(lacking)):.0f} less than with any contacts",
        hint="look at its stop first, then at cables that hold it, hinge_distance and half_track",
    )


def _bend(poses: FloatArray) -> tuple[float, FloatArray]:
    """Return to which side the hinge is bent at the end, and its angle (n,) to that side."""
    angle = poses[:, 2] - poses[:, 5]
    sign = float(np.sign(np.median(angle[len(angle) // 2 :]))) or 1.0
    return sign, sign * angle


def _simulated(system: RobotSystem, trial: int, k_lon: float, k_lat: float) -> Run:
    point = np.array([item.parameter.start for item in system.shared])
    for name, value in {"k_lon": k_lon, "k_lat": k_lat, "mu_d": 5.0, RATIO: 4.0}.items():
        point[SHARED.index(name)] = value
    return system.run(trial, point, np.zeros(len(LOCAL)))
