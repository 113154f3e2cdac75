"""Simulates a CAN bus between processes, for kernels without CAN.

Clients connect to an AF_UNIX SEQPACKET socket; each packet is one ``struct can_frame`` of Linux
(16 bytes, linux/can.h). Nodes of this process connect without a socket. The bus delivers every
frame to all clients and nodes except the sender, in the same order for all. A client that does not
read loses frames, which are counted and reported to it, and does not delay the others.
"""

from __future__ import annotations

import asyncio
import socket
import time
from collections import deque
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, ClassVar, Final

from rigd_sim.wire.can import disturbance
from rigd_sim.wire.can.disturbance import CAN_FRAME, ERROR_FLAG, NO_DETAIL, Disturbance
from rigd_sim.wire.can.timing import Arbiter, Frame
from rigd_sim.wire.part import Part, State

#: Frames taken from one client before others have their turn.
TURN: Final = 64

#: ``receive(can_id, data, t_ns)``: a frame has passed the bus at that CLOCK_MONOTONIC time.
Receive = Callable[[int, bytes, int], None]


class Port:
    """A node's place on the bus, with its acceptance filter."""

    def __init__(self, hub: CanHub, receive: Receive) -> None:
        self._hub = hub
        self.receive = receive
        self.accepted: frozenset[int] = frozenset()

    def listen(self, can_ids: Iterable[int]) -> None:
        """Receive frames with these identifiers from now on, and no others."""
        self.accepted = frozenset(can_ids)
        self._hub.route()

    def send(self, can_id: int, data: bytes) -> None:
        """Send a frame of at most 8 bytes to all others on the bus."""
        self._hub.submit(self, can_id, data)

    def detach(self) -> None:
        """Leave the bus; leaving twice is silent."""
        self._hub.detach(self)


class _Client:
    """A process that is connected to the bus."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.lost = 0
        self._untold = 0  #: of these, not reported to it yet

    def push(self, packet: bytes) -> None:
        """Hand a frame over, behind a report of those before it that found no room."""
        try:
            if self._untold:
                self.connection.send(disturbance.overflow(self._untold))
                self._untold = 0
            self.connection.send(packet)
        except BlockingIOError:
            self.lost += 1
            self._untold += 1
        except OSError:
            self.lost += 1  # it has gone: its socket turns readable and is closed there


class CanHub(Part):
    """A CAN bus at the socket ``path``; with ``bitrate`` (bit/s) each frame takes time."""

    faults: ClassVar = disturbance.FAULTS

    def __init__(
        self, name: str, path: Path, *, bitrate: float | None = None, seed: int = 0
    ) -> None:
        self.name = name
        self._path = path
        self._arbiter = None if bitrate is None else Arbiter(bitrate)
        self._timer: asyncio.TimerHandle | None = None
        self._listener: socket.socket | None = None
        self._clients: list[_Client] = []
        self._ports: list[Port] = []
        self._routes: dict[int, tuple[Port, ...]] = {}
        self._queue: deque[Frame] = deque()
        self._delivering = False
        self._disturbance = Disturbance(self._offer, self._report, seed)
        self._frames = 0
        self._malformed = 0
        self._lost = 0
        self._started_ns = 0

    async def start(self) -> str:
        """Listen at the socket; see :meth:`Part.start`."""
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            listener.setblocking(False)
            listener.bind(str(self._path))
            listener.listen(16)
        except OSError:
            listener.close()
            raise
        self._listener = listener
        self._started_ns = time.monotonic_ns()
        asyncio.get_running_loop().add_reader(listener, self._accept)
        return f"{self.name}: CAN bus at {self._path}"

    async def stop(self) -> None:
        """Close every connection and remove the socket."""
        if self._listener is None:
            return
        self._disturbance.stop()
        if self._timer is not None:
            self._timer.cancel()
        asyncio.get_running_loop().remove_reader(self._listener)
        self._listener.close()
        self._listener = None
        for client in tuple(self._clients):
            self._drop(client)
        self._path.unlink(missing_ok=True)

    def state(self) -> State:
        """Return clients, frames passed and lost, and how busy the bus is."""
        elapsed = time.monotonic_ns() - self._started_ns
        busy = 0 if self._arbiter is None else self._arbiter.busy_ns
        return {
            "clients": len(self._clients),
            "frames": self._frames,
            "lost": self._lost + sum(client.lost for client in self._clients),
            "malformed": self._malformed,
            "load": busy / elapsed if elapsed > 0 else 0.0,
            "faults": " ".join(self._disturbance.names),
        }

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault of the bus; see :data:`disturbance.FAULTS`.

        Raises:
            ValueError: no such fault, or not with these options.

        """
        if fault not in self.faults:
            raise ValueError(f"{self.name} has no fault {fault!r}; it knows {sorted(self.faults)}")
        self._disturbance.inject(fault, options)
        if fault == "stalled":
            self._read_clients(False)

    def clear(self, fault: str | None = None) -> None:
        """Stop showing ``fault``, or all of them."""
        stalled = "stalled" in self._disturbance.names
        self._disturbance.clear(fault)
        if stalled and "stalled" not in self._disturbance.names:
            self._read_clients(True)

    def attach(self, receive: Receive) -> Port:
        """Return a place on the bus for a node of this process; it accepts nothing yet."""
        port = Port(self, receive)
        self._ports.append(port)
        return port

    def detach(self, port: Port) -> None:
        """Take a node off the bus."""
        if port in self._ports:
            self._ports.remove(port)
            self.route()

    def route(self) -> None:
        """Take over what every port accepts."""
        routes: dict[int, tuple[Port, ...]] = {}
        for port in self._ports:
            for can_id in port.accepted:
                routes[can_id] = (*routes.get(can_id, ()), port)
        self._routes = routes

    def submit(self, sender: object, can_id: int, data: bytes) -> None:
        """Take a frame from ``sender`` to the bus."""
        if self._disturbance.active:
            self._disturbance.submit((sender, can_id, data))
        else:
            self._offer((sender, can_id, data))

    def _offer(self, frame: Frame) -> None:
        if self._arbiter is None:
            self._queue.append(frame)
            self._deliver()
        else:
            self._arbiter.offer(frame, time.monotonic_ns())
            self._wait(self._arbiter)

    def _wait(self, arbiter: Arbiter) -> None:
        due_ns = arbiter.due_ns
        if self._timer is None and due_ns is not None:
            self._timer = asyncio.get_running_loop().call_at(due_ns * 1e-9, self._passed, arbiter)

    def _passed(self, arbiter: Arbiter) -> None:
        """Deliver every frame whose time on the wire is over."""
        self._timer = None
        while (frame := arbiter.take(time.monotonic_ns())) is not None:
            self._queue.append(frame)
            self._deliver()
            arbiter.resume()
        self._wait(arbiter)

    def _deliver(self) -> None:
        """Hand over what is queued; frames sent meanwhile come behind, so all see one order."""
        if self._delivering:
            return
        self._delivering = True
        queue, clients = self._queue, self._clients
        try:
            while queue:
                sender, can_id, data = queue.popleft()
                self._frames += 1
                packet = CAN_FRAME.pack(can_id, len(data), data)
                for client in clients:
                    if client is not sender:
                        client.push(packet)
                receivers = self._routes.get(can_id)
                if receivers:
                    t_ns = time.monotonic_ns()
                    for port in receivers:
                        if port is not sender:
                            port.receive(can_id, data, t_ns)
        finally:
            self._delivering = False

    def _report(self, error: int) -> None:
        """Send an error frame to every client, as a controller reports to its host."""
        packet = CAN_FRAME.pack(error, len(NO_DETAIL), NO_DETAIL)
        for client in self._clients:
            client.push(packet)

    def _accept(self) -> None:
        if self._listener is None:
            return
        try:
            connection, _ = self._listener.accept()
        except BlockingIOError:
            return  # it has gone again
        connection.setblocking(False)
        client = _Client(connection)
        self._clients.append(client)
        if "stalled" not in self._disturbance.names:
            asyncio.get_running_loop().add_reader(connection, self._read, client)

    def _read(self, client: _Client) -> None:
        for _ in range(TURN):
            try:
                packet = client.connection.recv(CAN_FRAME.size + 1)
            except BlockingIOError:
                return
            except ConnectionError:
                packet = b""
            if not packet:
                self._drop(client)
                return
            if len(packet) != CAN_FRAME.size:
                self._malformed += 1
                continue
            can_id, length, data = CAN_FRAME.unpack(packet)
            if length > len(data) or can_id & ERROR_FLAG:
                self._malformed += 1  # no client can send an error frame on a bus
                continue
            self.submit(client, can_id, data[:length])

    def _read_clients(self, read: bool) -> None:
        loop = asyncio.get_running_loop()
        for client in self._clients:
            if read:
                loop.add_reader(client.connection, self._read, client)
            else:
                loop.remove_reader(client.connection)

    def _drop(self, client: _Client) -> None:
        asyncio.get_running_loop().remove_reader(client.connection)
        client.connection.close()
        self._clients.remove(client)
        self._lost += client.lost
