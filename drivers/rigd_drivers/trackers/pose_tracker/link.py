"""Receives the datagrams of a camera tracker, and hands each body's poses to its device."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from typing import Annotated, ClassVar, Final

from annotated_types import Ge, Le

from rigd.sdk import IdleReader, In, Link, LinkConfig, LinkError
from rigd.sdk.port import DatagramPort
from rigd_drivers.trackers.pose_tracker.inbox import Inbox
from rigd_drivers.trackers.pose_tracker.message import Frame, Unreadable, read_frame
from rigd_drivers.trackers.pose_tracker.time_base import TimeBase
from rigd_drivers.wait import looks

#: Datagrams looked at in one cycle; a camera with many bodies sends fewer.
DATAGRAMS_PER_CYCLE: Final = 16
#: While no cycle turns, what has come is taken in so often, in s.
READ_EVERY_S: Final = 0.02
#: The least delay is looked for so long before the first row, in ns.
SETTLING_NS: Final = 300_000_000
#: At most so many times a cycle's datagrams at once, while no cycle turns.
_BURSTS: Final = 32
#: Names of bodies that are remembered.
MOST_NAMES: Final = 32


class PoseTrackerConfig(LinkConfig):
    """Where the datagrams arrive, and what is known of their sender."""

    host: str = "127.0.0.1"
    """Address of this machine's network card to which they are sent; 0.0.0.0: any."""
    port: Annotated[int, Ge(1), Le(65535)]
    """UDP port to which they are sent."""
    sender: str | None = None
    """Host that sends them, by name or address; others are not heard. None: the first host from
    which a line came that can be read."""
    latency: Annotated[float, In("s"), Ge(0), Le(10)] = 0.0
    """Time from the exposure of a frame to the arrival of its datagram, if all goes well. Poses are
    recorded at the time of arrival without what delayed some of them, less this. 0: not known;
    an analysis may find it."""


class PoseTracker(Link):
    """A camera tracker that sends poses over UDP."""

    Config: ClassVar[type[LinkConfig]] = PoseTrackerConfig
    title: ClassVar[str] = "camera tracker that sends poses of bodies over UDP (JSON lines)"
    kind: ClassVar[str] = "pose-tracker"
    reads_on: ClassVar[bool] = True
    config: PoseTrackerConfig

    def __init__(
        self, config: PoseTrackerConfig, now_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        super().__init__(config)
        self._now_ns = now_ns
        self._port = DatagramPort(config.host, config.port, config.sender)
        self._latency_ns = round(config.latency * 1e9)
        self._bodies: dict[str, Inbox] = {}
        self._reader = IdleReader(self._read_idle, READ_EVERY_S)
        self._clear()

    def _clear(self) -> None:
        self.host = ""  #: the host that sends
        self.heard: set[str] = set()  #: names of bodies, at most MOST_NAMES
        self.rate_hz = 0.0  #: frames per second by the camera's clock; 0: not known yet
        self.good = 0  #: lines that could be read
        self._bad: Counter[str] = Counter()
        self._last = ""  # the last of them, in detail
        self._time = TimeBase()
        self._heard_ns = 0  # by the camera's clock
        self._ahead_ns: int | None = None  # the clock of the cycles before ours
        self._begun_ns: int | None = None
        self._frame: tuple[int, int] | None = None  # the newest, and the time recorded for it
        self._first: Frame | None = None

    @property
    def bad(self) -> int:
        """Datagrams and lines that could not be used."""
        return self._bad.total() + self._port.foreign + self._port.overlong

    def take(self, body: str, inbox: Inbox) -> None:
        """Hand the poses of ``body`` to ``inbox`` from now on.

        Raises:
            LinkError: another device has this body.

        """
        if body in self._bodies:
            raise LinkError(f"another device has body '{body}' of {self._port.where}")
        self._bodies[body] = inbox

    def let_go(self, inbox: Inbox) -> None:
        """Hand no more poses to ``inbox``."""
        self._bodies = {name: kept for name, kept in self._bodies.items() if kept is not inbox}

    @property
    def lost(self) -> int:
        """Datagrams that found the queue of the port full; see :class:`Link`."""
        return self._port.lost

    def open(self) -> None:
        """Open the port; see :class:`Link`."""
        self._port.open()
        self._clear()
        self._reader.start()

    def listen(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Read lines, before the first cycle, until ``until()``; return whether it came true.

        Raises:
            LinkError: the link is not open.
            DeviceError: the network of this machine fails.

        """
        with self._reader.lock:
            for left_s in looks(timeout_s):
                if until():
                    return True
                self._reader.check()
                if self._port.wait(left_s):
                    self._receive(self._hear)
            return until()

    def begin(self, t_ns: int) -> None:
        """Receive what has arrived; see :class:`Link`."""
        self._reader.pause()
        if self._begun_ns is None:
            self._begun_ns = t_ns
        ahead_ns = t_ns - self._now_ns()  # less what this cycle is late
        self._ahead_ns = ahead_ns if self._ahead_ns is None else max(ahead_ns, self._ahead_ns)
        self._receive(lambda frame: self._deliver(frame, t_ns))
        if self._port.crowded and t_ns - self._begun_ns >= SETTLING_NS:
            self._count("times too many in a cycle", "")

    def idle(self) -> None:
        """Throw away what comes while no cycle turns; see :class:`Link`."""
        self._ahead_ns = None
        self._reader.resume()

    def close(self) -> None:
        """Close the port; closing twice is silent."""
        self._reader.stop()
        self._port.close()

    def account(self) -> str:
        """Return in words what came and what was wrong with it."""
        wrong = dict(self._bad.most_common())
        if self._port.overlong:
            wrong["too long"] = self._port.overlong
        if self._port.foreign:
            wrong[f"from another host ({self._port.stranger})"] = self._port.foreign
        if self.lost:
            wrong["lost, since this computer did not take them in"] = self.lost
        if not self.good and not wrong:
            return f"nothing came at {self._port.where}"
        told = f"at {self._port.where} came {self.good} lines that can be read"
        if wrong:
            told += ", and others: " + ", ".join(f"{n} {kind}" for kind, n in wrong.items())
        return told + (f"; the last of these: {self._last}" if self._last else "")

    def _read_idle(self) -> None:
        """Take in what has come; it is too old for the first cycle. Bounded."""
        for _ in range(_BURSTS):
            self._receive(self._hear)
            if not self._port.crowded:
                return

    def _receive(self, deliver: Callable[[Frame], None]) -> None:
        for datagram in self._port.receive(DATAGRAMS_PER_CYCLE):
            for line in datagram.data.splitlines():
                try:
                    frame = read_frame(line)
                except Unreadable as error:
                    self._count(error.kind, error.detail)
                    continue
                self._note(frame, datagram.host)
                deliver(frame)

    def _note(self, frame: Frame, host: str) -> None:
        """Remember who sends, which bodies, and how often."""
        self.good += 1
        if not self.host:
            self.host = host
            self._port.only(host)
        self.heard.update(list(frame.bodies)[: MOST_NAMES - len(self.heard)])
        if self._first is None:
            self._first = frame
        elif frame.number > self._first.number:
            elapsed_ns = frame.camera_ns - self._first.camera_ns
            self.rate_hz = (frame.number - self._first.number) * 1e9 / max(elapsed_ns, 1)

    def _hear(self, frame: Frame) -> None:
        """Follow the delay of ``frame``, of which no cycle makes a row."""
        if frame.camera_ns < self._heard_ns:  # the tracker has begun anew, from another zero
            self._time = TimeBase()
        self._heard_ns = frame.camera_ns
        self._time.hear(self._now_ns(), frame.camera_ns)

    def _deliver(self, frame: Frame, t_ns: int) -> None:
        """Hand out the poses of ``frame``, which the cycle at ``t_ns`` has received."""
        ahead_ns = self._ahead_ns or 0
        taken_ns = self._time.hear(t_ns - ahead_ns, frame.camera_ns) + ahead_ns - self._latency_ns
        if self._begun_ns is None or t_ns - self._begun_ns < SETTLING_NS:
            return
        if self._frame is not None and self._frame[0] == frame.number:
            taken_ns = self._frame[1]  # bodies of one frame have one time, whenever they come
        self._frame = frame.number, taken_ns
        for name, pose in frame.bodies.items():
            inbox = self._bodies.get(name)
            if inbox is not None and (wrong := inbox.put(frame.number, taken_ns, pose)):
                self._count(wrong, f"frame {frame.number} of body {name[:40]!r}")

    def _count(self, kind: str, detail: str) -> None:
        self._bad[kind] += 1
        self._last = f"{kind}: {detail}" if detail else self._last
