"""Keeps the poses of one body until the cycle takes them, in the order of their frames."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

from rigd_drivers.trackers.pose_tracker.message import Pose

#: Poses that are kept: after a stall of the cycle all that came meanwhile are rows of their own.
KEPT: Final = 64


@dataclass(frozen=True)
class Seen:
    """A body in frame ``number``, and the time ``taken_ns`` that is recorded for it.

    ``lost`` frames before it were without the body, ``missed`` did not come, since the one before.
    """

    number: int
    taken_ns: int
    pose: Pose
    lost: int
    missed: int


class Inbox:
    """What has come of one body; poses of a lower quality than ``least`` count as lost."""

    def __init__(self, least: float, reach_m: float) -> None:
        self._least = least
        self._reach_m = reach_m
        self._queue: deque[Seen] = deque(maxlen=KEPT)
        self._frame: int | None = None  # the last that came
        self._taken_ns: int | None = None  # of the last pose
        self._lost = self._missed = 0
        self.frames = 0  #: that came, with the body or without
        self.lost = 0  #: of these, without the body

    def put(self, number: int, taken_ns: int, pose: Pose | None) -> str:
        """Take in a frame; return why it is not used, in words that are counted, or ""."""
        if self._frame is not None and number <= self._frame:
            return "a frame twice" if number == self._frame else "frames out of order"
        if pose is not None and max(abs(pose.x), abs(pose.y)) > self._reach_m:
            return "beyond reach"
        if self._taken_ns is not None and taken_ns <= self._taken_ns:
            return "a time that goes back"
        if self._frame is not None:
            self._missed += number - self._frame - 1
        self._frame = number
        self.frames += 1
        if pose is None or pose.quality < self._least:
            self.lost += 1
            self._lost += 1
            return ""
        self._taken_ns = taken_ns
        if len(self._queue) == KEPT:
            self._missed += 1
        self._queue.append(Seen(number, taken_ns, pose, self._lost, self._missed))
        self._lost = self._missed = 0
        return ""

    def take(self) -> Seen | None:
        """Return the oldest pose that was not taken; None if there is none."""
        return self._queue.popleft() if self._queue else None
