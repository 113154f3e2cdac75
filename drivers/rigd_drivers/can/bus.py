"""Operates a CAN bus with CANopen devices; rigd is the only master of the bus.

The class :class:`CanBus` is a link (a connection that several devices of a rig share). In every
cycle (one turn of the control loop) the link hands each received frame to the device that expects
it. Then the link sends the frames that the devices have queued, one SYNC (unless a device on the
bus sends SYNC), and the heartbeat when it is due. No other part of rigd sends heartbeats. If the
cycle hangs, no heartbeat is sent, and the drives switch themselves off.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal

from annotated_types import Ge, Gt, Le, MinLen
from pydantic import Field, field_validator

from rigd.sdk import DeviceSheet, IdleReader, In, Link, LinkConfig, LinkError, ProtocolError
from rigd_drivers.can.canopen import frames, nmt, sdo
from rigd_drivers.can.canopen.flood import FloodWatch
from rigd_drivers.can.load import EXTENDED_BITS, FRAME_BITS, LoadMeter
from rigd_drivers.can.ports import Frame, Full, Port, open_port

#: Bit rates of CANopen, in bit/s (CiA 301, 6.2).
_BIT_RATES: Final = (10e3, 20e3, 50e3, 125e3, 250e3, 500e3, 800e3, 1e6)
#: Frames taken at once, and more for each ms that the cycle was away: three times what a bus of
#: 1 Mbit/s carries in 1 ms. After a stall at most so many, which takes some 5 ms.
FRAMES_PER_MS: Final = 64
MOST_FRAMES: Final = 2048
#: While no cycle turns, what has come is taken in so often, in s: the queue of a socket, some 500
#: frames, fills in 25 ms at the most that a bus carries.
READ_EVERY_S: Final = 0.005
#: A queue that stays full for so long is a failure, in ns; see :data:`flood.WINDOW_NS`.
STALL_NS: Final = 50_000_000
#: Error frames in a row, with no good frame between, after which the bus is given up: as many as
#: make a transmitter error passive (CAN 2.0, error counter 128 by steps of 8).
ERRORS_IN_A_ROW: Final = 16
#: Shortest time for which the bus is listened to; no node sends heartbeats further apart, in s.
_SHORTEST_LISTENING_S: Final = 0.1


#: What to do about frames that were lost in a full queue.
OVERFLOW_HINT: Final = (
    "this computer did not take in what came: see `rigd doctor`, give it less work beside, or put "
    "other devices of this bus on another"
)


def overflow(lost: int) -> str:
    """Return in words that ``lost`` frames found the queue of the bus full."""
    return f"the bus overflowed: {lost} frame{'' if lost == 1 else 's'} lost"


class CanBusConfig(LinkConfig):
    """How the bus is reached, and which node the master is."""

    interface: Annotated[str, MinLen(1)]
    """`hub` (simulated), `socketcan`, or any interface of python-can: pcan, slcan, kvaser, ..."""
    channel: str = ""
    """Path of the hub's socket, `can0`, or what the adapter calls its channel."""
    bitrate: Annotated[float, In("bit/s"), Gt(0), Le(1e6)] = 1e6
    """Bits per second; every node must be set to the same (SocketCAN: set by `ip link`)."""
    adapter: dict[str, str] = Field(default_factory=dict)
    """Further options of the python-can interface, by name."""
    master_node: Annotated[int, Ge(1), Le(127)] = 127
    """Node id of rigd's own heartbeat."""
    heartbeat: Annotated[float, In("s"), Ge(0.001), Le(1)] = 0.02
    """Time between two heartbeats of rigd."""
    sync: bool = True
    """Whether rigd sends SYNC; false if a device on the bus sends it."""

    @field_validator("bitrate")
    @classmethod
    def _is_of_cia(cls, rate: float) -> float:
        if rate not in _BIT_RATES:
            known = ", ".join(f"{each / 1e3:g}" for each in _BIT_RATES)
            raise ValueError(f"{rate / 1e3:g} kbit/s is no bit rate of CANopen: {known} kbit/s")
        return rate


class CanBus(Link):
    """A CAN bus with CANopen on it."""

    Config: ClassVar[type[LinkConfig]] = CanBusConfig
    title: ClassVar[str] = "CAN bus, CANopen with rigd as master"
    kind: ClassVar[Literal["can"]] = "can"
    config: CanBusConfig

    def __init__(self, config: CanBusConfig) -> None:
        super().__init__(config)
        self.name = f"CAN bus {config.interface}:{config.channel}"
        self._port: Port | None = None
        self._reader = IdleReader(self._read_idle, READ_EVERY_S)
        self._clear()

    def _clear(self) -> None:
        self.syncs = 0  #: SYNCs on the bus since it was opened
        self.now_ns = time.monotonic_ns()  #: CLOCK_MONOTONIC of the cycle under way
        self.beating = False  #: whether heartbeats are sent while set-up waits
        #: Whether another master is an error; not while drives are made safe.
        self.alone = False
        self._rival = ""  #: what another master does
        self._ordered: set[int] = set()  #: nodes that another master sent NMT commands
        self.beat_ns = 0  #: when the last heartbeat was sent
        self.foreign = 0  #: frames that no device of this rig expects
        self.heard: set[int] = set()  #: nodes that gave a sign of life: heartbeats, SDO replies
        self._handlers: dict[int, Callable[[bytes], None]] = {}
        self._owners: dict[int, str] = {}
        self._resume: dict[int, Callable[[], None]] = {}
        self._orders: list[bytes] = []
        self._outbox: dict[int, bytes] = {}
        self._overflows = 0
        self.errors = 0  #: error frames of the controller
        self._errors_in_a_row = 0
        self._full_since = 0
        self._flood = FloodWatch(self.now_ns)
        self._cycled_ns = 0
        self._meter = LoadMeter(self.config.bitrate, self.now_ns)

    @property
    def load(self) -> float | None:
        """Share of the time that frames took on the bus lately, at most."""
        return self._meter.load

    @property
    def lost(self) -> int:
        """Frames lost since the bus was opened because they were not taken in; see :class:`Link`.

        A controller that reports an overflow without a number counts as one.
        """
        return self._overflows + (0 if self._port is None else self._port.lost())

    @property
    def is_open(self) -> bool:
        """Whether the bus is open."""
        return self._port is not None

    @property
    def behind(self) -> bool:
        """Whether more has come than was taken in: what was taken may then be old."""
        return self._flood.crowded

    @classmethod
    def read_sheet(cls, path: Path) -> DeviceSheet:
        """Return the content of the EDS or DCF at ``path``; see :class:`~rigd.sdk.Link`."""
        from rigd_drivers.can.canopen.sheet_view import describe

        return describe(path)

    # -- opening and closing -------------------------------------------------------------------

    def open(self) -> None:
        """Open the bus and listen for a while: no other master may be on it.

        Raises:
            LinkError: it cannot be opened, another master drives it, or it carries only errors.
        """
        self.open_second()
        self.alone = True
        own = self.config.master_node
        self._handlers[frames.NMT] = self._rival_orders
        self.reserve_identifier(frames.HEARTBEAT + own, f"sends the heartbeat of node {own}")
        if self.config.sync:
            self.reserve_identifier(frames.SYNC, "sends SYNC")
        listening_s = max(3 * self.config.heartbeat, _SHORTEST_LISTENING_S)
        try:
            self.wait(lambda: False, listening_s)
            if self.errors and not self._meter.bits:  # no good frame was among them
                raise self.broken("only errors are heard")
        except LinkError:
            self.close()
            raise

    def open_second(self) -> None:
        """Open the bus without listening, to make its drives safe when its master has died.

        Raises:
            LinkError: it cannot be opened.

        """
        if self._port is not None:
            return
        config = self.config
        self._clear()
        rate = round(config.bitrate)
        self._port = open_port(config.interface, config.channel, rate, config.adapter)
        if not config.sync:
            self._handlers[frames.SYNC] = self._count_sync
        self._reader.start()

    def close(self) -> None:
        """Close the bus; closing twice is silent."""
        self._reader.stop()
        port, self._port = self._port, None
        if port is not None:
            port.close()

    def claim(self, node: int, owner: str) -> None:
        """Note that ``owner`` commands node ``node``.

        Raises:
            ProtocolError: another device of the rig file does.

        """
        if node == self.config.master_node:
            raise ProtocolError(
                f"node id {node} on {self.name} is rigd's own",
                hint="give the device, or `master_node` of the link, another id",
            )
        if node in self._owners:
            raise ProtocolError(
                f"two devices of the rig file have node id {node} on {self.name}: "
                f"{self._owners[node]}, and {owner}",
                hint="correct `node` of one of them",
            )
        self._owners[node] = owner
        if node in self._ordered:
            self._found_rival(f"sends NMT commands to node {node}")

    def release(self, node: int) -> None:
        """Forget a node and what was to be done for it."""
        self._owners.pop(node, None)
        self._resume.pop(node, None)

    def subscribe(self, identifier: int, handler: Callable[[bytes], None]) -> None:
        """Hand the data of every frame with ``identifier`` to ``handler``."""
        self._handlers[identifier] = handler

    def reserve_identifier(self, identifier: int, does: str) -> None:
        """Take a frame with ``identifier`` for that of another master, which then ``does`` it."""
        self._handlers[identifier] = lambda data: self._found_rival(does)

    def hear_other_clients(self, node: int, heard: Callable[[], None]) -> None:
        """Call ``heard`` for each SDO request of another client to ``node``.

        One that writes is another master: what was read back may no longer be so.
        """

        def request(data: bytes) -> None:
            heard()
            if written := sdo.written_by(data):
                self._found_rival(f"writes object {written} of node {node} by SDO")

        self._handlers[frames.SDO_REQUEST + node] = request

    def listen(self, identifier: int, handler: Callable[[bytes], None]) -> None:
        """Hand the data of every frame with ``identifier`` to ``handler`` as well.

        An identifier of 29 bits has the flag :data:`frames.EXTENDED`.
        """
        before = self._handlers.get(identifier)
        if before is None:
            self._handlers[identifier] = handler
            return

        def both(data: bytes) -> None:
            before(data)
            handler(data)

        self._handlers[identifier] = both

    def on_resume(self, node: int, action: Callable[[], None]) -> None:
        """Call ``action`` for ``node`` in the first cycle, and after a pause without heartbeats."""
        self._resume[node] = action

    # -- the cycle -----------------------------------------------------------------------------

    def begin(self, t_ns: int) -> None:
        """Take in what has come, a bounded number of frames.

        Raises:
            LinkError: the bus is lost, flooded, or has a second master.

        """
        self._reader.pause()
        now = self.now_ns = time.monotonic_ns()
        away_ns = now - self._cycled_ns
        paused = away_ns > 3e9 * self.config.heartbeat
        flood = self._flood
        most = min(FRAMES_PER_MS * max(1, away_ns // 1_000_000), MOST_FRAMES)
        flood.left(not self._take(most), now)
        self._check_rival()
        if flooding := flood.judge(now):
            raise LinkError(
                f"{self.name} is flooded: {flooding}",
                hint="switch that node off or correct its PDO transmission type",
            )
        if paused and self._resume:  # last, so that frames received meanwhile count no more
            self.beat()  # a node that still misses it may refuse to be operational
            for action in self._resume.values():
                action()

    def end(self, t_ns: int) -> None:
        """Send what is queued, then SYNC, then the heartbeat if it is due.

        Raises:
            LinkError: the bus is lost, or takes no frames.

        """
        self._empty(self._send)
        now = time.monotonic_ns()
        self._cycled_ns = now
        self._meter.look(now)
        self._beat_if_due(now)

    def idle(self) -> None:
        """Let the bus be read on while no cycle turns; see :class:`Link`."""
        self._reader.resume()

    def put(self, identifier: int, data: bytes) -> None:
        """Queue a PDO for the end of the cycle; a newer one takes the place of an older."""
        self._outbox[identifier] = data

    def order(self, command: nmt.Command, node: int) -> None:
        """Queue an NMT command for the end of the cycle."""
        self._orders.append(nmt.command(command, node))

    def flush(self) -> None:
        """Send what is queued, and SYNC, now.

        Raises:
            LinkError: the bus is lost, or takes no frames.

        """
        self._empty(self.send)

    def _empty(self, send: Callable[[int, bytes], None]) -> None:
        orders, self._orders = self._orders, []
        for data in orders:
            send(frames.NMT, data)
        outbox, self._outbox = self._outbox, {}
        for identifier, data in outbox.items():
            send(identifier, data)
        if self.config.sync:
            send(frames.SYNC, b"")
            self.syncs += 1

    # -- set-up: before the first cycle, may wait ----------------------------------------------

    def send(self, identifier: int, data: bytes) -> None:
        """Send a frame now; wait a little if the queue is full.

        Raises:
            LinkError: the bus is lost, or accepts no frames.
        """
        try:
            with self._reader.lock:
                self._opened().press(identifier, data)
        except Full as error:
            raise self._stuck(error) from error

    def beat(self) -> None:
        """Send a heartbeat now.

        Raises:
            LinkError: see :meth:`send`.

        """
        self._send(frames.HEARTBEAT + self.config.master_node, nmt.heartbeat())
        self.beat_ns = time.monotonic_ns()

    def wait(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Take in frames until ``until()``, at most ``timeout_s``; return whether it came true.

        Sends heartbeats meanwhile if :attr:`beating`.

        Raises:
            LinkError: the bus is lost, or has a second master.

        """
        port = self._opened()
        deadline_ns = time.monotonic_ns() + round(timeout_s * 1e9)
        with self._reader.lock:
            while True:
                self._reader.check()
                now = self.now_ns = time.monotonic_ns()  # what comes in a stall after it is taken
                self._take(FRAMES_PER_MS)
                self._check_rival()
                if until():
                    return True
                pause_ns = deadline_ns - now
                if pause_ns <= 0:
                    return False
                if self.beating:
                    self._beat_if_due(now)
                    due_ns = self.beat_ns + round(self.config.heartbeat * 1e9)
                    pause_ns = max(0, min(pause_ns, due_ns - now))
                port.wait(pause_ns * 1e-9)

    # -- within --------------------------------------------------------------------------------

    def _opened(self) -> Port:
        if self._port is None:
            raise LinkError(f"{self.name} is not open")
        return self._port

    def _read_idle(self) -> None:
        """Take in what has come while nobody else reads; bounded, since a bus may be flooded."""
        if self._port is not None:
            self._take(MOST_FRAMES)

    def _beat_if_due(self, now_ns: int) -> None:
        # Half a millisecond early rather than a cycle late.
        if now_ns - self.beat_ns >= self.config.heartbeat * 1e9 - 500_000:
            self.beat()

    def _send(self, identifier: int, data: bytes) -> None:
        """Send a frame; one that finds the queue full is lost, if that does not last."""
        try:
            with self._reader.lock:
                self._opened().send(identifier, data)
        except Full as error:
            now = time.monotonic_ns()
            if not self._full_since:
                self._full_since = now
            elif now - self._full_since > STALL_NS:
                raise self._stuck(error) from error
            return
        self._full_since = 0
        self._meter.bits += FRAME_BITS[len(data)]

    def _take(self, most: int) -> bool:
        """Dispatch up to ``most`` frames; return whether these were all."""
        receive = self._opened().receive
        handlers, flood, meter = self._handlers, self._flood, self._meter
        for _ in range(most):
            frame = receive()
            if frame is None:
                return True
            identifier, data = frame
            if flood.crowded:
                flood.count(identifier)
            if identifier > 0x7FF:
                self._no_canopen(frame)
                continue
            self._errors_in_a_row = 0
            meter.bits += FRAME_BITS[len(data)]
            handler = handlers.get(identifier)
            if handler is not None:
                handler(data)
            else:
                self._unexpected(identifier)
        return False

    def _unexpected(self, identifier: int) -> None:
        self.foreign += 1
        if not self._flood.crowded:
            self._flood.count(identifier)
        for base in (frames.HEARTBEAT, frames.SDO_REPLY):
            if identifier - base in frames.NODES:
                self.heard.add(identifier - base)

    def _no_canopen(self, frame: Frame) -> None:
        identifier, data = frame
        if not identifier & frames.ERROR:
            self._errors_in_a_row = 0
            self._meter.bits += EXTENDED_BITS[len(data)]
            handler = self._handlers.get(identifier)
            if handler is None:
                self.foreign += 1
            else:
                handler(data)
            return
        self._overflows += frames.is_overflow(identifier, data)
        if frames.is_only_news(identifier, data):
            return
        self.errors += 1
        self._errors_in_a_row += 1
        if frames.is_bus_off(identifier) or self._errors_in_a_row >= ERRORS_IN_A_ROW:
            raise self.broken(frames.describe_error(identifier, data))

    def _count_sync(self, data: bytes) -> None:
        self.syncs += 1

    def _rival_orders(self, data: bytes) -> None:
        """Note an NMT command of another master; to nodes that are not ours it may send them."""
        node = data[1] if len(data) > 1 else 0
        if not node:
            self._found_rival("sends NMT commands")
        elif node in self._owners:
            self._found_rival(f"sends NMT commands to node {node}")
        else:
            self._ordered.add(node)
            self.foreign += 1

    def _found_rival(self, does: str) -> None:
        """Note another master; it is raised where frames are taken in, in no other thread."""
        if self.alone and not self._rival:
            self._rival = does

    def _check_rival(self) -> None:
        if self._rival and self.alone:
            raise LinkError(
                f"another rigd (or CANopen master) drives {self.name}: it {self._rival}",
                hint="stop it; if a device is meant to send SYNC, set `sync: false` on the link",
            )

    def _stuck(self, why: Full) -> LinkError:
        return LinkError(
            f"{self.name} takes no frames: {why}",
            hint="no node acknowledges, or the bus is overloaded: check power, wiring, "
            f"termination (120 ohm at both ends) and that all nodes use {self._rate()}; on "
            "SocketCAN also: ip link set IF txqueuelen 1000",
        )

    def broken(self, what: str) -> LinkError:
        """Return the error that reports frames destroyed on the wire."""
        return LinkError(
            f"{self.name}: {what}",
            hint=f"check that all nodes and the adapter use the same bitrate ({self._rate()} in "
            "the rig file), wiring and termination (120 ohm at both ends); after bus-off the "
            "interface must be restarted: ip link set IF down, then up",
        )

    def _rate(self) -> str:
        return f"{self.config.bitrate / 1000:g} kbit/s"
