"""Simulates a camera tracker that sends poses as JSON lines in UDP datagrams, and its faults.

The format is `poses-1` of docs/devices.md, written here again.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import random
import socket
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Final

from rigd_sim.wire.options import number
from rigd_sim.wire.part import Part, State

#: x and y in m, heading in rad; None: not found.
Poses = Mapping[str, tuple[float, float, float] | None]
#: The clock of the camera has no particular zero, in s.
CLOCK_S: Final = 7319.25
#: Where a stranger sends from: another address of this machine.
STRANGER: Final = "127.0.0.2"
#: Largest UDP datagram, less what others of the line need.
_LONG: Final = 60000

_CHANCE: Final[Mapping[str, tuple[float, float, float]]] = {"probability": (1.0, 0.0, 1.0)}


class SimTracker(Part):
    """A camera that takes ``rate_hz`` frames a second and sends each to ``host`` and ``port``.

    Args:
        name: of the part.
        host: where the datagrams go.
        port: the UDP port there.
        look: returns the poses of all bodies in a frame: its number, and how long ago it was
            exposed, in s. It is called when the frame is sent.
        rate_hz: frames per second.
        latency_s: from exposure to sending.
        jitter_s: sending comes up to so much later, by chance.
        drift_ppm: by how many parts in a million the camera's clock runs fast.
        seed: of chance.
    """

    faults: ClassVar[Mapping[str, str]] = {
        "silent": "sends nothing",
        "lost": "does not find a body (body: all; probability=1)",
        "exchanged": "takes each body for the next one (probability=1)",
        "dropped": "datagrams do not come (probability=1)",
        "late": "datagrams come late (delay_s=1)",
        "frozen": "sends the same frame again and again",
        "restarted": "counts frames and time from zero, once",
        "scale": "lengths are wrong by this share (by=0.05)",
        "duplicate": "datagrams come twice (probability=1)",
        "reordered": "a frame comes after the next one (probability=1)",
        "garbage": "lines of random bytes (probability=1)",
        "nan": "x of every body is NaN (probability=1)",
        "field": "a pose has no heading (probability=1)",
        "unit": "sends millimetres and degrees, and names them",
        "degrees": "sends degrees, and does not name them",
        "long": "datagrams of 60 kB (probability=1)",
        "stranger": "another host sends poses of its own beside it",
        "flood": "another program of its host sends without a pause (rate_hz=20000)",
    }
    #: Options of faults: what they are unless given, the least and the largest.
    fault_options: ClassVar[Mapping[str, Mapping[str, tuple[float, float, float]]]] = {
        **dict.fromkeys(
            ("lost", "exchanged", "dropped", "duplicate", "reordered", "garbage", "nan", "field"),
            _CHANCE,
        ),
        "long": _CHANCE,
        "late": {"delay_s": (1.0, 0.0, 60.0)},
        "scale": {"by": (0.05, -0.9, 9.0)},
        "flood": {"rate_hz": (20e3, 1.0, 1e6)},
    }

    def __init__(
        self,
        name: str,
        host: str,
        port: int,
        look: Callable[[int, float], Poses],
        *,
        rate_hz: float = 25.0,
        latency_s: float = 0.0,
        jitter_s: float = 0.0,
        drift_ppm: float = 0.0,
        seed: int = 0,
    ) -> None:
        self.name = name
        self._to = host, port
        self._look = look
        self._period_s = 1.0 / (rate_hz * (1 + drift_ppm * 1e-6))
        self._rate_hz = rate_hz
        self._latency_s = latency_s
        self._jitter_s = jitter_s
        self._random = random.Random(seed)
        self._active: dict[str, dict[str, Any]] = {}
        self._socket: socket.socket | None = None
        self._stranger: socket.socket | None = None
        self._timers: dict[str, asyncio.TimerHandle] = {}
        self._later: set[asyncio.TimerHandle] = set()
        self._held: bytes | None = None
        self._began_s = 0.0
        self._number = self._first = 0
        self._frozen = b""
        self.sent = 0  #: frames, each counted before it is sent
        self.found: Poses = {}  #: what it sent last, in m and rad

    async def start(self) -> str:
        """Begin to take frames; see :meth:`Part.start`."""
        self._socket = _udp()
        self._began_s = asyncio.get_running_loop().time()
        self._number = self._first = 0
        self._next()
        return f"{self.name}: poses to UDP port {self._to[1]} of {self._to[0]}"

    async def stop(self) -> None:
        """Take no more frames; stopping twice is silent."""
        for handle in (*self._timers.values(), *self._later):
            handle.cancel()
        self._timers.clear()
        self._later.clear()
        for own in (self._socket, self._stranger):
            if own is not None:
                own.close()
        self._socket = self._stranger = None

    def state(self) -> State:
        """Return how many frames it has taken and sent."""
        return {"frame": self._number - self._first, "sent": self.sent}

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault; see :meth:`Part.inject`."""
        if fault not in self.faults:
            raise ValueError(f"{self.name} has no fault {fault!r}; it has {', '.join(self.faults)}")
        chosen: dict[str, Any] = {}
        if fault == "lost" and "body" in options:
            chosen["body"] = str(options.pop("body"))
        for name, (default, low, high) in self.fault_options.get(fault, {}).items():
            chosen[name] = number(options, name, default, low=low, high=high)
        if options:
            raise ValueError(f"fault {fault!r} has no option {', '.join(sorted(options))}")
        if fault == "restarted":
            self._first = self._number
            return
        self._active[fault] = chosen
        if fault == "flood":
            self._flood()

    def clear(self, fault: str | None = None) -> None:
        """Stop showing ``fault``, or all of them."""
        for item in list(self._active) if fault is None else [fault]:
            self._active.pop(item, None)
        if "flood" not in self._active and "flood" in self._timers:
            self._timers.pop("flood").cancel()

    def _next(self) -> None:
        """Send the frame that is due, and wait for the next one."""
        loop = asyncio.get_running_loop()
        exposed_s = self._began_s + self._number * self._period_s
        due_s = exposed_s + self._latency_s
        if loop.time() >= due_s:
            self._take(self._number, loop.time() - exposed_s)
            # Frames that this machine has stalled over are not sent: a camera does not wait.
            behind = int((loop.time() - due_s) / self._period_s)
            self._number += 1 + behind
            due_s += (1 + behind) * self._period_s
        when_s = due_s + self._jitter_s * self._random.random()
        self._timers["frame"] = loop.call_at(when_s, self._next)

    def _take(self, frame: int, ago_s: float) -> None:
        poses = self._seen(dict(self._look(frame, ago_s)))
        line = self._line(frame, poses)
        if "frozen" in self._active:
            line = self._frozen or line
        self._frozen = line
        if "silent" in self._active or self._happens("dropped"):
            return
        self.found = poses
        if "stranger" in self._active:
            self._send_as_stranger(frame, poses)
        if self._happens("reordered") and self._held is None:
            self._held = line
            return
        self._send(line)
        if self._happens("duplicate"):
            self._send(line)
        if self._held is not None:
            held, self._held = self._held, None
            self._send(held)

    def _seen(self, poses: dict[str, tuple[float, float, float] | None]) -> Poses:
        if self._happens("exchanged"):
            names = list(poses)
            poses = {name: poses[names[i - 1]] for i, name in enumerate(names)}
        if self._happens("lost"):
            chosen = self._active["lost"].get("body")
            poses = {k: None if chosen in (None, k) else pose for k, pose in poses.items()}
        if "scale" in self._active:
            by = 1.0 + self._active["scale"]["by"]
            poses = {k: pose and (by * pose[0], by * pose[1], pose[2]) for k, pose in poses.items()}
        return poses

    def _line(self, frame: int, poses: Poses) -> bytes:
        if self._happens("garbage"):
            return self._random.randbytes(200)
        length = turn = 1.0
        if "unit" in self._active:
            length = 1000.0
        if "unit" in self._active or "degrees" in self._active:
            turn = 57.29577951308232
        x_nan = self._happens("nan")
        bodies: dict[str, Any] = {
            name: None
            if pose is None
            else {
                "x": float("nan") if x_nan else round(length * pose[0], 6),
                "y": round(length * pose[1], 6),
                "heading": round(turn * pose[2], 6),
                "quality": 1.0,
            }
            for name, pose in poses.items()
        }
        if self._happens("field"):
            for body in bodies.values():
                if body is not None:
                    del body["heading"]
        found = {
            "format": "poses-1",
            "units": ["mm", "deg"] if "unit" in self._active else ["m", "rad"],
            "frame": frame - self._first,
            "time": round(CLOCK_S * (not self._first) + (frame - self._first) / self._rate_hz, 6),
            "bodies": bodies,
        }
        line = json.dumps(found).encode() + b"\n"
        return line + b" " * _LONG if self._happens("long") else line

    def _send(self, line: bytes) -> None:
        if "late" in self._active:
            loop = asyncio.get_running_loop()
            self._later = {item for item in self._later if item.when() > loop.time()}
            delay_s = float(self._active["late"]["delay_s"])
            self._later.add(loop.call_later(delay_s, self._send_now, line))
        else:
            self._send_now(line)

    def _send_now(self, line: bytes) -> None:
        self.sent += 1
        self._to_wire(self._socket, line)

    def _to_wire(self, own: socket.socket | None, line: bytes) -> None:
        if own is not None:
            # No reader yet, or its queue is full: datagrams are lost, as on a network.
            with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
                own.sendto(line, self._to)

    def _send_as_stranger(self, frame: int, poses: Poses) -> None:
        if self._stranger is None:
            self._stranger = _udp(STRANGER)
        elsewhere = {name: (1.0, 1.0, 0.0) for name in poses}
        self._to_wire(self._stranger, self._line(frame + 1, elsewhere))

    def _flood(self) -> None:
        """Send what falls due in 2 ms at once, in place of one by one."""
        loop = asyncio.get_running_loop()
        for _ in range(round(float(self._active["flood"]["rate_hz"]) * 2e-3)):
            self._to_wire(self._socket, b"?" * 64)
        self._timers["flood"] = loop.call_later(2e-3, self._flood)

    def _happens(self, fault: str) -> bool:
        options = self._active.get(fault)
        return options is not None and self._random.random() < options["probability"]


def _udp(host: str = "") -> socket.socket:
    own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    own.setblocking(False)
    if host:
        own.bind((host, 0))
    return own
