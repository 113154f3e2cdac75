"""A CAN bus of scripted nodes, in memory: what is sent is kept, answers come at once.

Written against CiA 301 and 402 with nothing of the drivers but their port, so that a bug of theirs
is not shared.
"""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field

import pytest

from rigd_drivers.can.ports import Frame, Full, Port

Address = tuple[int, int]


@dataclass
class ScriptedNode:
    """A node with an object dictionary of bytes; what it does wrong is set by the test."""

    node: int
    objects: dict[Address, bytes]
    refuse: dict[Address, int] = field(default_factory=dict)  #: abort code of writes
    stuck: set[Address] = field(default_factory=set)  #: takes writes, keeps what it has
    replies: int = 1  #: how often each SDO reply comes
    sized: bool = True  #: expedited replies state how many bytes are the value
    silent: bool = False
    beats: bool = True  #: heartbeats on NMT commands
    state: int = 0x7F
    outputs: deque[Frame] = field(default_factory=deque)

    def hear(self, identifier: int, data: bytes) -> None:
        if self.silent:
            return
        if identifier == 0x000 and data[1] in (0, self.node):
            self.state = {0x01: 0x05, 0x80: 0x7F, 0x02: 0x04}[data[0]]
            if self.beats:
                self.outputs.append((0x700 + self.node, bytes([self.state])))
        elif identifier == 0x600 + self.node and data[0] == 0x80:
            pass  # an abort has no answer
        elif identifier == 0x600 + self.node and self.state != 0x04:  # stopped: no SDO
            for _ in range(self.replies):
                self.outputs.append((0x580 + self.node, self._serve(data)))

    def _serve(self, request: bytes) -> bytes:
        address = (int.from_bytes(request[1:3], "little"), request[3])
        where = request[1:4]
        known = self.objects.get(address)
        if request[0] >> 5 == 1:  # download, expedited
            value = request[4 : 8 - (request[0] >> 2 & 3)]
            code = self.refuse.get(address) or self._forbidden(address, value)
            if code:
                return b"\x80" + where + code.to_bytes(4, "little")
            if known is None:
                return b"\x80" + where + bytes.fromhex("00 00 02 06")
            if address not in self.stuck:
                self.objects[address] = value
                self.written(address, value)
            return b"\x60" + where + bytes(4)
        if known is None:
            return b"\x80" + where + bytes.fromhex("00 00 02 06")
        if not self.sized:
            return b"\x42" + where + known.ljust(4, b"\xee")
        return bytes([0x43 | 4 - len(known) << 2]) + where + known.ljust(4, b"\0")

    def _forbidden(self, address: Address, value: bytes) -> int:
        """Return the abort code of a write to a PDO that CiA 301 (7.5.2.35 to 38) forbids."""
        index, sub = address
        if not 0x1400 <= index < 0x1C00:
            return 0
        valid = self.objects[index & 0xFDFF, 1]  # the COB-id
        if valid[3] & 0x80:
            return 0x0800_0022 if index & 0x200 and sub and self.objects[index, 0] != b"\0" else 0
        if index & 0x200:
            return 0x0800_0022
        return 0 if sub == 1 and value[:3] == valid[:3] else 0x0609_0030

    def written(self, address: Address, value: bytes) -> None:
        """React to a value that was written."""


class ScriptedServo(ScriptedNode):
    """A CiA 402 drive that is led through its states by SDO; its watchdog never acts."""

    def written(self, address: Address, value: bytes) -> None:
        if address == (0x6060, 0):
            self.objects[0x6061, 0] = value
        if address == (0x6040, 0):
            fault = self.objects[0x6041, 0][0] & 0x4F == 0x08
            word = int.from_bytes(value, "little")
            if fault and not word & 0x80:
                return
            status = {0x06: 0x0231, 0x07: 0x0233, 0x0F: 0x1237}.get(word, 0x0250)
            self.objects[0x6041, 0] = status.to_bytes(2, "little")


def number(value: int, size: int) -> bytes:
    return value.to_bytes(size, "little", signed=value < 0)


def pdo(index: int, mapping: int, cob_id: int) -> dict[Address, bytes]:
    """A PDO as a drive has it out of the box."""
    communication = {(index, 1): number(cob_id, 4), (index, 2): b"\xff", (index, 3): b"\x0a\x00"}
    return communication | {(mapping, sub): bytes(1 if sub == 0 else 4) for sub in range(5)}


def common(node: int, device_type: int, serial: int) -> dict[Address, bytes]:
    objects = {
        (0x1000, 0): number(device_type, 4),
        (0x1008, 0): b"Test",
        (0x1017, 0): number(0, 2),
        (0x1018, 1): number(0xFB, 4),
        (0x1018, 4): number(serial, 4),
    }
    for place in range(4):
        objects |= pdo(0x1800 + place, 0x1A00 + place, 0x180 + 0x100 * place + node)
    return objects


def servo(node: int = 1, mode: int = 10, serial: int = 4711) -> ScriptedServo:
    """A drive with a motor of 1.5 A, 29.5 mN m/A."""
    objects = common(node, 0x0002_0192, serial)
    for place in range(2):
        objects |= pdo(0x1400 + place, 0x1600 + place, 0x200 + 0x100 * place + node)
    objects |= {
        (0x1003, 1): number(0, 4),
        (0x1016, 1): number(0, 4),
        (0x3001, 5): number(29_500, 4),
        (0x6007, 0): number(3, 2),
        (0x6040, 0): number(0, 2),
        (0x6041, 0): number(0x0250, 2),
        (0x6060, 0): b"\x00",
        (0x6061, 0): b"\x00",
        (0x6064, 0): number(0, 4),
        (0x6071, 0): number(0, 2),
        (0x6076, 0): number(44_250, 4),
        (0x60A9, 0): number(0xFDB44700, 4),
        (0x60FE, 1): number(0, 4),
        (0x60FF, 0): number(0, 4),
        (0x6502, 0): number(1 << mode - 1, 4),
    }
    return ScriptedServo(node, objects)


def plain_servo(node: int = 1, mode: int = 10) -> ScriptedServo:
    """The same motor on a drive of another maker, with the units of CiA 402-2."""
    drive = servo(node, mode)
    del drive.objects[0x3001, 5]
    drive.objects |= {
        (0x1018, 1): number(0x9A, 4),
        (0x6075, 0): number(1500, 4),
        (0x6076, 0): number(44, 4),
    }
    return drive


def encoder(node: int = 11, serial: int = 815) -> ScriptedNode:
    """An encoder of 4096 steps and 4096 revolutions."""
    objects = common(node, 0x0001_0196, serial) | {
        (0x6004, 0): number(100, 4),
        (0x6501, 0): number(4096, 4),
        (0x6502, 0): number(4096, 2),
    }
    return ScriptedNode(node, objects)


def use(port: ScriptedBus, monkeypatch: pytest.MonkeyPatch) -> ScriptedBus:
    """Let every bus that is opened be ``port``; it is read by calls alone, never by a thread."""
    monkeypatch.setattr("rigd_drivers.can.bus.open_port", lambda *_: port)
    monkeypatch.setattr("rigd_drivers.can.bus.READ_EVERY_S", 3600.0)
    return port


class ScriptedBus(Port):
    """The port that leads to the nodes; ``sent`` is everything that was sent, in order."""

    def __init__(self, *nodes: ScriptedNode, room: int | None = None) -> None:
        self.nodes = nodes
        self.room = room  #: frames that wait to be read at most; None: any number
        self.dropped = 0
        self.sent: list[Frame] = []
        self.coming: deque[Frame] = deque()
        self.full = False
        self.closed = 0

    def receive(self) -> Frame | None:
        return self.coming.popleft() if self.coming else None

    def send(self, identifier: int, data: bytes) -> None:
        if self.full:
            raise Full("its queue is full")
        self.sent.append((identifier, data))
        for node in self.nodes:
            node.hear(identifier, data)
            for frame in node.outputs:
                self._come(frame)
            node.outputs.clear()

    def wait(self, timeout_s: float) -> None:
        if not self.coming:
            time.sleep(timeout_s)

    def close(self) -> None:
        self.closed += 1

    def say(self, identifier: int, data: bytes | str) -> None:
        """Let a frame come, from any node."""
        self._come((identifier, bytes.fromhex(data) if isinstance(data, str) else data))

    def lost(self) -> int:
        return self.dropped

    def _come(self, frame: Frame) -> None:
        if self.room is not None and len(self.coming) >= self.room:
            self.dropped += 1
        else:
            self.coming.append(frame)
