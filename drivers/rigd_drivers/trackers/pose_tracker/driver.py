"""Reads the pose of one body that a camera tracker sees."""

from __future__ import annotations

import math
from enum import IntFlag
from typing import Annotated, ClassVar, Final

from annotated_types import Ge, Gt, Le, MinLen

from rigd.sdk import Channel, Declaration, DeviceError, Driver, DriverConfig, In, LinkError, Row
from rigd_drivers.trackers.pose_tracker.inbox import Inbox
from rigd_drivers.trackers.pose_tracker.link import SETTLING_NS, PoseTracker

#: How long the first frames with the body are waited for, in s.
OPEN_S: Final = 3.0
#: The driver fails before the cycle calls it silent, so that its message is seen, also while the
#: link settles; in s.
_MARGIN_S: Final = 0.5
#: Bits 16 to 23 of a status count what could not be used of all that came, modulo 256.
_COUNT_SHIFT: Final = 16
_COUNT_MASK: Final = 0xFF


class PoseStatus(IntFlag):
    """The status word of a row; each bit speaks of the time since the row before."""

    LOST = 1  #: frames came in which the tracker had not found the body
    MISSED = 2  #: frames of the tracker did not come
    UNREADABLE = 4  #: datagrams came that could not be used


class BodyConfig(DriverConfig):
    """Which body it is, and which poses are believed."""

    body: Annotated[str, MinLen(1)]
    """Its name in the datagrams."""
    reach: Annotated[float, In("m"), Gt(0), Le(1e4)] = 50.0
    """Largest x and y of either sign; a pose beyond is not believed."""
    least_quality: Annotated[float, In("1"), Ge(0), Le(1)] = 0.0
    """A pose with a lower quality counts as one that was not found."""
    silence: Annotated[float, In("s"), Ge(0.1), Le(60)] = 2.0
    """Without a pose for so long the body has failed. An interlock may be quicker."""


class BodyRow(Row):
    """The body in a frame; status: :class:`PoseStatus`."""

    x: float
    y: float
    heading: float
    frame: float
    status: int


class TrackedBody(Driver[BodyConfig, PoseTracker]):
    """A body that a camera tracker sees; it only measures, so it is always safe.

    Each frame in which the tracker has found the body gives a row, one in a cycle, at the time that
    :class:`PoseTracker` finds for the frame. A frame without the body gives none, and is counted.
    """

    Config: ClassVar[type[DriverConfig]] = BodyConfig
    title: ClassVar[str] = "body that a camera tracker sees: x, y and heading"
    link_kind = "pose-tracker"

    def __init__(self, config: BodyConfig, link: PoseTracker) -> None:
        super().__init__(config, link)
        self._inbox: Inbox | None = None
        self._silence_ns = round(config.silence * 1e9)
        self._since_ns: int | None = None  # when the last pose was taken, or the first could come
        self._bad = 0

    @classmethod
    def declare(cls, config: BodyConfig) -> Declaration:
        """Return the pose, which comes at the tracker's pace."""
        reach = config.reach
        return Declaration(
            channels=(
                Channel("x", "m", "position of the body by the tracker", -reach, reach),
                Channel("y", "m", "position of the body by the tracker", -reach, reach),
                Channel("heading", "rad", "heading of the body, -pi to pi", -math.pi, math.pi),
                Channel("frame", "count", "number of the frame by the tracker's own count"),
            ),
            row=BodyRow,
            status_bits={(bit.name or "").lower(): bit.value for bit in PoseStatus},
            every_cycle=False,
            silent_s=config.silence + _MARGIN_S,
        )

    def open(self) -> None:
        """Wait for frames that name the body, found or not.

        Raises:
            LinkError: none comes; names what came instead. Or another device has this body.
            DeviceError: the network of this machine fails.

        """
        link, body = self.link, self.config.body
        if self._inbox is not None:
            raise LinkError(f"body '{body}' is open already", hint="close it first")
        inbox = Inbox(self.config.least_quality, self.config.reach)
        link.take(body, inbox)
        if not link.listen(lambda: body in link.heard and link.rate_hz > 0, OPEN_S):
            link.let_go(inbox)
            names = ", ".join(sorted(link.heard))
            raise LinkError(
                f"no frames with body '{body}' came within {OPEN_S:g} s: {link.account()}"
                + (f"; bodies: {names}" if names else ""),
                hint="is the tracker on, does it send to this machine and port, and under this "
                "name? A firewall may hold UDP back",
            )
        self._inbox, self._since_ns = inbox, None
        self.identity = f"body '{body}', {link.rate_hz:.3g} frames/s from {link.host}"

    def arm(self) -> None:
        """Do nothing: it only measures."""

    def read(self, t_ns: int) -> BodyRow | None:
        """Return the next pose, None if there is no new one; see :class:`Driver`.

        Raises:
            DeviceError: none came for `silence`; names what came instead.
            LinkError: it is not open.

        """
        if self._inbox is None:
            raise LinkError(f"body '{self.config.body}' is not open")
        seen = self._inbox.take()
        if self._since_ns is None:
            self._since_ns = t_ns + SETTLING_NS
        if seen is None:
            if t_ns - self._since_ns > self._silence_ns:
                raise self._silent()
            return None
        self.taken_ns = self._since_ns = seen.taken_ns
        bad, status = self.link.bad, PoseStatus(0)
        if seen.lost:
            status |= PoseStatus.LOST
        if seen.missed:
            status |= PoseStatus.MISSED
        if bad != self._bad:
            status |= PoseStatus.UNREADABLE
        self._bad = bad
        return BodyRow.of(
            x=seen.pose.x,
            y=seen.pose.y,
            heading=seen.pose.heading,
            frame=float(seen.number),
            status=int(status) | (bad & _COUNT_MASK) << _COUNT_SHIFT,
        )

    def make_safe(self) -> None:
        """Do nothing: it only measures."""

    def close(self) -> None:
        """Take no more poses; closing twice is silent."""
        inbox, self._inbox = self._inbox, None
        if inbox is not None:
            self.link.let_go(inbox)

    def _silent(self) -> DeviceError:
        body, inbox = self.config.body, self._inbox
        frames, lost = (0, 0) if inbox is None else (inbox.frames, inbox.lost)
        return DeviceError(
            f"no pose of body '{body}' for {self.config.silence:g} s (in {lost} of {frames} frames "
            f"the tracker had not found it); {self.link.account()}",
            hint="is it in view, and the tracker on?",
        )
