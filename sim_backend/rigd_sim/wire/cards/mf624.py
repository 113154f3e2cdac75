"""Serves a simulated MF624 card on a socket: one packet per register access.

The socket is AF_UNIX, SEQPACKET. A request is eight bytes in the machine's order: the operation
(uint8: 0 read 16 bits, 1 write 16, 2 read 32, 3 write 32), BAR (uint8), offset (uint16), value
(uint32, 0 for a read). The card answers a read with a uint32 and does not answer a write, because
PCI posts writes. Several masters may connect, as a UIO device may be opened more than once.
"""

from __future__ import annotations

import asyncio
import socket
import struct
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, Protocol

from rigd_sim.wire.cards.mf624_registers import Mf624Registers
from rigd_sim.wire.part import Part, State

_REQUEST: Final = struct.Struct("=BBHI")
_ANSWER: Final = struct.Struct("=I")
#: The bench is brought to now this often when no master reads, in s.
_TICK_S: Final = 0.002
#: Accesses served for one master before others have their turn: more than a cycle makes.
_TURN: Final = 32


class Bench(Protocol):
    """What is wired to the card: drives, a one-shot, sensors."""

    faults: Mapping[str, str]

    def advance(self) -> None:
        """Bring it to now."""

    def state(self) -> State:
        """Return what an observer sees."""

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault; raises ValueError as :meth:`Part.inject`."""

    def clear(self, fault: str | None = None) -> None:
        """Stop showing it."""


class SimMf624(Part):
    """An MF624 at the socket ``path``, with its bench."""

    def __init__(self, name: str, path: Path, card: Mf624Registers, bench: Bench) -> None:
        self.name = name
        self.faults = {**card.faults, **bench.faults}  # type: ignore[misc] # depends on the bench
        self._path = path
        self._card = card
        self._bench = bench
        self._listener: socket.socket | None = None
        self._masters: list[socket.socket] = []
        self._timer: asyncio.TimerHandle | None = None
        self._accesses = 0
        self._malformed = 0
        self._serve: Mapping[int, Callable[[tuple[int, int], int], int | None]] = {
            0: lambda register, _: card.r16(register),
            1: card.w16,
            2: lambda register, _: card.r32(register),
            3: card.w32,
        }

    async def start(self) -> str:
        """Listen at the socket; see :meth:`Part.start`."""
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            listener.setblocking(False)
            listener.bind(str(self._path))
            listener.listen(4)
        except OSError:
            listener.close()
            raise
        self._listener = listener
        asyncio.get_running_loop().add_reader(listener, self._accept)
        self._tick()
        return f"MF624 card at {self._path}"

    async def stop(self) -> None:
        """Close every connection and remove the socket."""
        if self._listener is None:
            return
        asyncio.get_running_loop().remove_reader(self._listener)
        self._listener.close()
        self._listener = None
        if self._timer is not None:
            self._timer.cancel()
        for master in tuple(self._masters):
            self._drop(master)
        self._path.unlink(missing_ok=True)

    def state(self) -> State:
        """Return what the outputs of the card show, and what the bench does."""
        self._bench.advance()
        outputs = {f"da{index}": volts for index, volts in enumerate(self._card.volts)}
        return {
            "masters": len(self._masters),
            "accesses": self._accesses,
            "malformed": self._malformed,
            "lines": self._card.lines,
            **outputs,
            **self._bench.state(),
        }

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault of the card, or of what is wired to it."""
        if fault in self._bench.faults:
            self._bench.inject(fault, **options)
        elif fault in self._card.faults:
            self._card.inject(fault, **options)
        else:
            raise ValueError(
                f"{self.name} has no fault {fault!r}; it knows {', '.join(self.faults)}"
            )

    def clear(self, fault: str | None = None) -> None:
        """Stop showing ``fault``, or all of them."""
        self._card.clear(fault)
        self._bench.clear(fault)

    def _tick(self) -> None:
        self._bench.advance()
        self._timer = asyncio.get_running_loop().call_later(_TICK_S, self._tick)

    def _accept(self) -> None:
        if self._listener is None:
            return
        master, _ = self._listener.accept()
        master.setblocking(False)
        self._masters.append(master)
        asyncio.get_running_loop().add_reader(master, self._take, master)

    def _take(self, master: socket.socket) -> None:
        try:
            for _ in range(_TURN):
                packet = master.recv(2 * _REQUEST.size)
                if not packet:
                    self._drop(master)
                    return
                self._access(master, packet)
        except BlockingIOError:
            return  # all served; or a master that does not read its answers, which it then misses
        except OSError:
            self._drop(master)

    def _access(self, master: socket.socket, packet: bytes) -> None:
        if len(packet) != _REQUEST.size or packet[0] not in self._serve:
            self._malformed += 1
            return
        what, bar, offset, value = _REQUEST.unpack(packet)
        self._accesses += 1
        answer = self._serve[what]((bar, offset), value)
        if answer is not None:
            master.send(_ANSWER.pack(answer))

    def _drop(self, master: socket.socket) -> None:
        asyncio.get_running_loop().remove_reader(master)
        master.close()
        self._masters.remove(master)
