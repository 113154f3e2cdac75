"""A program on the simulated CAN bus: a real socket, frames as the kernel lays them out."""

from __future__ import annotations

import asyncio
import socket
import struct
from collections.abc import Callable, Coroutine
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from rigd_sim.wire.service import precise_loop

T = TypeVar("T")
P = ParamSpec("P")

#: Linux `struct can_frame`, written again: the hub's own must agree with it.
CAN_FRAME = struct.Struct("<I B 3x 8s")
#: Nothing takes so long, not even on a machine that stalls.
PATIENCE_S = 10.0
#: Silence is silence after so long.
SILENCE_S = 0.1

Frame = tuple[int, str]


def run(scenario: Coroutine[Any, Any, T]) -> T:
    """Run a scenario on the loop that the simulation runs on; errors in callbacks fail it."""

    async def guarded() -> T:
        errors: list[dict[str, Any]] = []
        asyncio.get_running_loop().set_exception_handler(lambda _, error: errors.append(error))
        result = await scenario
        assert not errors, errors
        return result

    with asyncio.Runner(loop_factory=precise_loop) as runner:
        return runner.run(guarded())


def on_loop(test: Callable[P, Coroutine[Any, Any, None]]) -> Callable[P, None]:
    """Let a test :func:`run` as a scenario."""

    @wraps(test)
    def on_its_loop(*args: P.args, **kwargs: P.kwargs) -> None:
        run(test(*args, **kwargs))

    return on_its_loop


class Client:
    """One program on a bus."""

    def __init__(self, path: Path) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.socket.connect(str(path))
        self.socket.setblocking(False)

    def send(self, can_id: int, data: str = "") -> None:
        """Send a frame with the data in hexadecimal."""
        payload = bytes.fromhex(data)
        self.socket.send(CAN_FRAME.pack(can_id, len(payload), payload))

    async def receive(self) -> Frame:
        """Return the next frame, its data in hexadecimal."""
        loop = asyncio.get_running_loop()
        packet = await asyncio.wait_for(loop.sock_recv(self.socket, 64), PATIENCE_S)
        can_id, length, data = CAN_FRAME.unpack(packet)
        return can_id, data[:length].hex(" ")

    async def frames(self, count: int) -> list[Frame]:
        """Return the next frames."""
        return [await self.receive() for _ in range(count)]

    async def until(self, can_id: int) -> str:
        """Return the data of the next frame with that identifier, passing over others."""
        while True:
            got, data = await self.receive()
            if got == can_id:
                return data

    async def silent(self, silence_s: float = SILENCE_S) -> bool:
        """Return whether nothing comes for a while."""
        loop = asyncio.get_running_loop()
        try:
            await asyncio.wait_for(loop.sock_recv(self.socket, 64), silence_s)
        except TimeoutError:
            return True
        return False

    async def sdo(self, node: int, request: str) -> str:
        """Send an SDO request to a node and return its answer."""
        self.send(0x600 + node, request)
        return await self.until(0x580 + node)

    def close(self) -> None:
        self.socket.close()
