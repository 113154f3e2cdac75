"""Simulates a scale on a serial port; a pseudo-terminal (pty) takes the place of the port."""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import termios
import time
import tty
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Final, Literal

from rigd_sim.wire.part import Part, State
from rigd_sim.wire.scale_languages import (
    AndD,
    AndDIndicator,
    Language,
    Nameplate,
    Sbi,
    Sics,
    Trouble,
)
from rigd_sim.wire.scale_weighing import DISPLAY_UNITS, Weighing

#: How often the load cell is sampled and waiting commands are checked, in s.
TICK_S: Final = 0.02
#: Longest command kept, in bytes.
MAX_COMMAND: Final = 64
#: Faults that replace every reply by one of the scale's own errors.
_TROUBLES: Final = {
    "syntax": Trouble.SYNTAX, "transmission": Trouble.TRANSMISSION, "logic": Trouble.LOGIC,
    "busy": Trouble.BUSY,
}  # fmt: skip
#: Faults of the wire, which damage single lines with a probability.
_WIRE: Final = ("garbage", "nul", "partial", "merged", "no_cr", "echo", "late", "lost")


class SimScale(Part):
    """A scale with one of five protocols on a pty, which keeps the same name.

    ``mass()`` is the load on the pan in kg, ``rests()`` whether it keeps still. The pty stands
    behind the symbolic link ``path``. A client that opens it at another baud rate than ``baud``
    gets bytes that mean nothing.
    """

    faults: ClassVar[Mapping[str, str]] = {
        "garbage": "lines of random bytes (probability=1)",
        "nul": "NUL bytes among the others, as a break makes them (probability=1)",
        "partial": "lines cut off in the middle (probability=1)",
        "merged": "two lines without an end between them (probability=1)",
        "no_cr": "lines that end in LF alone (probability=1)",
        "echo": "commands come back before the answer (probability=1)",
        "late": "answers come after delay_s=0.7 (probability=1)",
        "lost": "answers do not come (probability=1)",
        "syntax": "answers that the command is unknown (ES)",
        "transmission": "answers that bytes were damaged (ET)",
        "logic": "answers that it cannot carry out the command (EL)",
        "busy": "answers that it is busy (S I)",
        "overload": "shows overload (S +)",
        "underload": "shows underload (S -)",
        "never_stable": "the weight never comes to rest",
        "unit": "the unit is changed at the keypad (unit=lb)",
        "stream": "a stream is on, as the last session left it; until cancelled (act once)",
        "silent": "sends nothing, receives nothing",
        "unplug": "the adapter is pulled; cleared, it is plugged in under another number",
    }

    def __init__(
        self,
        name: str,
        path: Path,
        mass: Callable[[], float],
        *,
        dialect: Literal[
            "mt-sics", "kern-kcp", "and-d", "and-d-indicator", "sartorius-sbi"
        ] = "mt-sics",
        baud: int = 9600,
        unit: str = "kg",
        capacity_kg: float = 60.0,
        division_kg: float = 0.001,
        noise_kg: float = 0.0002,
        settling_s: float = 0.1,
        serial: str = "B021002593",
        seed: int = 0,
        rests: Callable[[], bool] | None = None,
    ) -> None:
        self.name = name
        self.path = path
        self.weighing = Weighing(
            capacity_kg=capacity_kg, division_kg=division_kg, noise_kg=noise_kg,
            settling_s=settling_s, unit=unit, seed=seed, rests=rests,
        )  # fmt: skip
        languages = {"and-d": AndD, "and-d-indicator": AndDIndicator, "sartorius-sbi": Sbi}
        language = languages.get(dialect, Sics)
        self._language: Language = language(self.weighing, Nameplate("SIM60", serial), 0.1)
        self._mass = mass
        self._baud = getattr(termios, f"B{baud}")
        self._unit = unit
        self._random = random.Random(seed)
        self._active: dict[str, dict[str, Any]] = {}
        self._command = bytearray()
        self._fds: tuple[int, int] | None = None  # our end, and theirs, held open
        self._ticking: asyncio.TimerHandle | None = None
        self._later: set[asyncio.TimerHandle] = set()

    async def start(self) -> str:
        """Open the pty; see :meth:`Part.start`."""
        self._plug_in()
        self._tick()
        return f"{self.name}: scale at {self.path}"

    async def stop(self) -> None:
        """Close the pty and take its name away."""
        if self._ticking is not None:
            self._ticking.cancel()
            self._ticking = None
        for handle in self._later:
            handle.cancel()
        self._later.clear()
        self._unplug()

    def state(self) -> State:
        """What the display shows, and what stands behind it."""
        weighing = self.weighing
        return {
            "load_kg": self._mass(),
            "shown": f"{weighing.shown()} {weighing.unit}",
            "stable": weighing.stable,
            "tare_kg": weighing.tare_kg,
            "streaming": self._language.streaming,
            "plugged_in": self._fds is not None,
            "faults": ", ".join(self._active),
        }

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault; see :meth:`Part.inject`."""
        allowed = self._options(fault)
        if unknown := options.keys() - allowed.keys():
            raise ValueError(
                f"fault {fault!r} has no option {', '.join(sorted(unknown))}; "
                f"it has {', '.join(allowed) or 'none'}"
            )
        chosen = {**allowed, **options}
        if fault == "unit" and chosen["unit"] not in DISPLAY_UNITS:
            known = ", ".join(DISPLAY_UNITS)
            raise ValueError(f"the scale cannot show {chosen['unit']!r}; it can show {known}")
        self._active[fault] = chosen
        if fault == "unplug":
            self._unplug()
        elif fault == "stream":
            self._language.streaming = True
            del self._active["stream"]  # it ends as a stream ends, by a command
        self._apply()

    def clear(self, fault: str | None = None) -> None:
        """Stop showing ``fault``, or all of them."""
        for item in list(self._active) if fault is None else [fault]:
            if self._active.pop(item, None) is not None and item == "unplug":
                self._plug_in()
        self._apply()

    def _options(self, fault: str) -> dict[str, Any]:
        if fault not in self.faults:
            raise ValueError(f"{self.name} has no fault {fault!r}; it has {', '.join(self.faults)}")
        options: dict[str, Any] = {"probability": 1.0} if fault in _WIRE else {}
        if fault == "late":
            options["delay_s"] = 0.7
        elif fault == "unit":
            options["unit"] = "lb"
        return options

    def _apply(self) -> None:
        weighing, active = self.weighing, self._active
        weighing.beyond = ("overload" in active) - ("underload" in active)
        weighing.never_stable = "never_stable" in active
        weighing.unit = active["unit"]["unit"] if "unit" in active else self._unit

    def _plug_in(self) -> None:
        # The new name takes the old one's place at once; if the old one leads to a pty that is
        # alive, another simulation holds it.
        if self.path.is_symlink() and not self.path.exists():
            self.path.unlink()
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

    def _unplug(self) -> None:
        if self._fds is None:
            return
        ours, theirs = self._fds
        self._fds = None
        asyncio.get_running_loop().remove_reader(ours)
        self.path.unlink(missing_ok=True)
        os.close(ours)
        os.close(theirs)

    def _tick(self) -> None:
        now = time.monotonic()
        self.weighing.advance(now, self._mass())
        for line in self._language.tick(now):
            self._reply(line)
        self._ticking = asyncio.get_running_loop().call_later(TICK_S, self._tick)

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
                    self._on_command(command)
            elif len(self._command) < MAX_COMMAND:
                self._command.append(byte)

    def _on_command(self, command: bytes) -> None:
        if self._happens("echo"):
            self._send(command + b"\r\n")
        trouble = next((why for fault, why in _TROUBLES.items() if fault in self._active), None)
        if trouble is not None:
            self._reply(self._language.trouble(trouble))
            return
        now = time.monotonic()
        self.weighing.advance(now, self._mass())
        for line in self._language.answer(command, now):
            self._reply(line)

    def _reply(self, line: bytes) -> None:
        if not line or self._happens("lost"):
            return
        data = line + b"\r\n"
        if self._happens("garbage"):
            data = self._random.randbytes(len(data))
        if self._happens("nul"):
            data = b"\0".join(data[i : i + 1] for i in range(len(data)))
        if self._happens("partial"):
            data = data[: self._random.randrange(1, len(line))]
        if self._happens("merged"):
            data = line + data
        if self._happens("no_cr"):
            data = data.replace(b"\r", b"")
        if self._happens("late"):
            loop = asyncio.get_running_loop()
            delay_s = float(self._active["late"]["delay_s"])
            self._later = {item for item in self._later if item.when() > loop.time()}
            self._later.add(loop.call_later(delay_s, self._send, data))
            return
        self._send(data)

    def _happens(self, fault: str) -> bool:
        options = self._active.get(fault)
        return options is not None and self._random.random() < options["probability"]

    def _send(self, data: bytes) -> None:
        if self._fds is None or "silent" in self._active:
            return
        ours, theirs = self._fds
        if termios.tcgetattr(theirs)[5] != self._baud:
            data = self._random.randbytes(len(data))  # bits sampled at the wrong moments
        with contextlib.suppress(BlockingIOError):  # no reader: bytes are lost, as on a wire
            os.write(ours, data)
