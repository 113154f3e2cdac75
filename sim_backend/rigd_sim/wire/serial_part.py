"""Simulates a device that takes commands and sends lines on a serial port, and its bad wires.

A pseudo-terminal (pty) takes the place of the port.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Final

from rigd_sim.wire.part import Part

#: Longest command kept, in bytes.
MAX_COMMAND: Final = 64
#: Faults of the wire, which damage single lines with a probability.
WIRE_FAULTS: Final[Mapping[str, str]] = {
    "garbage": "lines of random bytes (probability=1)",
    "nul": "NUL bytes among the others, as a break makes them (probability=1)",
    "partial": "lines cut off in the middle (probability=1)",
    "merged": "two lines without an end between them (probability=1)",
    "no_cr": "lines that end in LF alone (probability=1)",
    "echo": "commands come back before the answer (probability=1)",
    "late": "answers come after delay_s=0.7 (probability=1)",
    "lost": "answers do not come (probability=1)",
}
#: Faults of the port as a whole.
PORT_FAULTS: Final[Mapping[str, str]] = {
    "silent": "sends nothing, receives nothing",
    "unplug": "the adapter is pulled; cleared, it is plugged in under another number",
}


class SerialPart(Part):
    """A device on a pty, which stands behind the symbolic link ``path`` and keeps that name.

    A client that opens it at another baud rate than ``baud`` gets bytes that mean nothing.
    """

    faults: ClassVar[Mapping[str, str]] = {**WIRE_FAULTS, **PORT_FAULTS}
    #: Options of faults that are not of the wire, with what they are unless given.
    fault_options: ClassVar[Mapping[str, Mapping[str, Any]]] = {"late": {"delay_s": 0.7}}

    def __init__(self, name: str, path: Path, *, baud: int, seed: int, end: bytes) -> None:
        self.name = name
        self.path = path
        self._baud = baud
        self._end = end
        self._random = random.Random(seed)
        self._active: dict[str, dict[str, Any]] = {}
        self._command = bytearray()
        self._fds: tuple[int, int] | None = None  # our end, and theirs, held open
        self._later: set[asyncio.TimerHandle] = set()

    @abstractmethod
    def on_command(self, command: bytes) -> None:
        """Obey a command, which has come without its end."""

    def show(self, fault: str) -> None:
        """Begin to show a fault of the device's own, whose options are noted."""

    def cleared(self) -> None:
        """Note that faults have ended; those that are left are :meth:`shown`."""

    def shown(self, fault: str) -> Mapping[str, Any] | None:
        """Return the options of ``fault``; None if it is not shown."""
        return self._active.get(fault)

    @property
    def plugged_in(self) -> bool:
        """Whether the port is there."""
        return self._fds is not None

    async def stop(self) -> None:
        """Close the pty and take its name away."""
        for handle in self._later:
            handle.cancel()
        self._later.clear()
        self.unplug()

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault; see :meth:`Part.inject`."""
        if fault not in self.faults:
            raise ValueError(f"{self.name} has no fault {fault!r}; it has {', '.join(self.faults)}")
        allowed = {"probability": 1.0} if fault in WIRE_FAULTS else {}
        allowed |= self.fault_options.get(fault, {})
        if unknown := options.keys() - allowed.keys():
            raise ValueError(
                f"fault {fault!r} has no option {', '.join(sorted(unknown))}; "
                f"it has {', '.join(allowed) or 'none'}"
            )
        chosen = {**allowed, **options}
        self.check_fault(fault, chosen)
        self._active[fault] = chosen
        if fault == "unplug":
            self.unplug()
        self.show(fault)

    def check_fault(self, fault: str, options: Mapping[str, Any]) -> None:
        """Refuse options of a fault that cannot be shown.

        Raises:
            ValueError: they cannot.

        """

    def clear(self, fault: str | None = None) -> None:
        """Stop showing ``fault``, or all of them."""
        for item in list(self._active) if fault is None else [fault]:
            if self._active.pop(item, None) is not None and item == "unplug":
                self.plug_in()
        self.cleared()

    def plug_in(self) -> None:
        """Make the port.

        Raises:
            OSError: another simulation holds its name.

        """
        # The new name takes the old one's place at once; if the old one leads to a pty that is
        # alive, another simulation holds it.
        if self.path.is_symlink() and not self.path.exists():
            self.path.unlink()
        import tty  # Windows has none

        ours, theirs = os.openpty()
        try:
            self.path.symlink_to(os.ttyname(theirs))
        except OSError:
            os.close(ours)
            os.close(theirs)
            raise
        tty.setraw(theirs)
        os.set_blocking(ours, False)
        self._fds = (ours, theirs)
        self._command.clear()
        asyncio.get_running_loop().add_reader(ours, self._on_bytes)

    def unplug(self) -> None:
        """Take the port away; twice is silent."""
        if self._fds is None:
            return
        ours, theirs = self._fds
        self._fds = None
        asyncio.get_running_loop().remove_reader(ours)
        self.path.unlink(missing_ok=True)
        os.close(ours)
        os.close(theirs)

    def reply(self, line: bytes) -> None:
        """Send ``line`` with its end, as the wire lets it through."""
        if not line or self._happens("lost"):
            return
        data = line + self._end
        if self._happens("garbage"):
            data = self._random.randbytes(len(data))
        if self._happens("nul"):
            data = b"\0".join(data[i : i + 1] for i in range(len(data)))
        if self._happens("partial"):
            data = data[: self._random.randrange(1, max(2, len(line)))]
        if self._happens("merged"):
            data = line + data
        if self._happens("no_cr"):
            data = data.replace(b"\r", b"")
        if self._happens("late"):
            loop = asyncio.get_running_loop()
            delay_s = float(self._active["late"]["delay_s"])
            self._later = {item for item in self._later if item.when() > loop.time()}
            self._later.add(loop.call_later(delay_s, self.send, data))
            return
        self.send(data)

    def send(self, data: bytes) -> None:
        """Send bytes, which mean nothing to a client with another baud rate."""
        if self._fds is None or "silent" in self._active:
            return
        ours, theirs = self._fds
        import termios

        if termios.tcgetattr(theirs)[5] != getattr(termios, f"B{self._baud}"):
            data = self._random.randbytes(len(data))  # bits sampled at the wrong moments
        with contextlib.suppress(BlockingIOError):  # no reader: bytes are lost, as on a wire
            os.write(ours, data)

    def _on_bytes(self) -> None:
        if self._fds is None:
            return
        try:
            data = os.read(self._fds[0], 4096)
        except BlockingIOError:
            return
        if "silent" in self._active:
            return
        for byte in data:
            if byte in b"\r\n":
                command, self._command = bytes(self._command), bytearray()
                if command:
                    if self._happens("echo"):
                        self.send(command + self._end)
                    self.on_command(command)
            elif len(self._command) < MAX_COMMAND:
                self._command.append(byte)

    def _happens(self, fault: str) -> bool:
        options = self._active.get(fault)
        return options is not None and self._random.random() < options["probability"]
