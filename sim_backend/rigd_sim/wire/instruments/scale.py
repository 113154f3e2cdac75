"""Simulates a scale on a serial port."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Final, Literal

from rigd_sim.wire.instruments.scale_languages import (
    AndD,
    AndDIndicator,
    Language,
    Nameplate,
    Ohaus,
    Sbi,
    Sics,
    Trouble,
)
from rigd_sim.wire.instruments.scale_weighing import DISPLAY_UNITS, Weighing
from rigd_sim.wire.part import State
from rigd_sim.wire.serial_part import PORT_FAULTS, WIRE_FAULTS, SerialPart

#: How often the load cell is sampled and waiting commands are checked, in s.
TICK_S: Final = 0.02
#: Faults that replace every reply by one of the scale's own errors.
_TROUBLES: Final = {
    "syntax": Trouble.SYNTAX, "transmission": Trouble.TRANSMISSION, "logic": Trouble.LOGIC,
    "busy": Trouble.BUSY,
}  # fmt: skip


class SimScale(SerialPart):
    """A scale with one of six protocols on a pty, which keeps the same name.

    ``mass()`` is the load on the pan in kg, ``rests()`` whether it keeps still. The pty stands
    behind the symbolic link ``path``. A client that opens it at another baud rate than ``baud``
    gets bytes that mean nothing.
    """

    faults: ClassVar[Mapping[str, str]] = {
        **WIRE_FAULTS,
        "syntax": "answers that the command is unknown (ES)",
        "transmission": "answers that bytes were damaged (ET)",
        "logic": "answers that it cannot carry out the command (EL)",
        "busy": "answers that it is busy (S I)",
        "overload": "shows overload (S +)",
        "underload": "shows underload (S -)",
        "never_stable": "the weight never comes to rest",
        "unit": "the unit is changed at the keypad (unit=lb)",
        "stream": "a stream is on, as the last session left it; until cancelled (act once)",
        **PORT_FAULTS,
    }
    fault_options: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        **SerialPart.fault_options,
        "unit": {"unit": "lb"},
    }

    def __init__(
        self,
        name: str,
        path: Path,
        mass: Callable[[], float],
        *,
        dialect: Literal[
            "mt-sics", "kern-kcp", "and-d", "and-d-indicator", "sartorius-sbi", "ohaus"
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
        super().__init__(name, path, baud=baud, seed=seed, end=b"\r\n")
        self.weighing = Weighing(
            capacity_kg=capacity_kg, division_kg=division_kg, noise_kg=noise_kg,
            settling_s=settling_s, unit=unit, seed=seed, rests=rests,
        )  # fmt: skip
        languages = {
            "and-d": AndD,
            "and-d-indicator": AndDIndicator,
            "sartorius-sbi": Sbi,
            "ohaus": Ohaus,
        }
        language = languages.get(dialect, Sics)
        self._language: Language = language(self.weighing, Nameplate("SIM60", serial), 0.1)
        self._mass = mass
        self._unit = unit
        self._ticking: asyncio.TimerHandle | None = None

    async def start(self) -> str:
        """Open the pty; see :meth:`Part.start`."""
        self.plug_in()
        self._tick()
        return f"{self.name}: scale at {self.path}"

    async def stop(self) -> None:
        """Close the pty and take its name away."""
        if self._ticking is not None:
            self._ticking.cancel()
            self._ticking = None
        await super().stop()

    def state(self) -> State:
        """What the display shows, and what stands behind it."""
        weighing = self.weighing
        return {
            "load_kg": self._mass(),
            "shown": f"{weighing.shown()} {weighing.unit}",
            "stable": weighing.stable,
            "tare_kg": weighing.tare_kg,
            "streaming": self._language.streaming,
            "plugged_in": self.plugged_in,
            "faults": ", ".join(self._active),
        }

    def check_fault(self, fault: str, options: Mapping[str, Any]) -> None:
        """Refuse a unit that the scale cannot show."""
        if fault == "unit" and options["unit"] not in DISPLAY_UNITS:
            known = ", ".join(DISPLAY_UNITS)
            raise ValueError(f"the scale cannot show {options['unit']!r}; it can show {known}")

    def show(self, fault: str) -> None:
        """Show a fault of the scale; see :class:`SerialPart`."""
        if fault == "stream":
            self._language.streaming = True
            del self._active["stream"]  # it ends as a stream ends, by a command
        self.cleared()

    def cleared(self) -> None:
        """Weigh with the faults that are left."""
        weighing, active = self.weighing, self._active
        weighing.beyond = ("overload" in active) - ("underload" in active)
        weighing.never_stable = "never_stable" in active
        weighing.unit = active["unit"]["unit"] if "unit" in active else self._unit

    def _tick(self) -> None:
        now = time.monotonic()
        self.weighing.advance(now, self._mass())
        for line in self._language.tick(now):
            self.reply(line)
        self._ticking = asyncio.get_running_loop().call_later(TICK_S, self._tick)

    def on_command(self, command: bytes) -> None:
        """Answer a command, or with the trouble that is shown."""
        trouble = next((why for fault, why in _TROUBLES.items() if fault in self._active), None)
        if trouble is not None:
            self.reply(self._language.trouble(trouble))
            return
        now = time.monotonic()
        self.weighing.advance(now, self._mass())
        for line in self._language.answer(command, now):
            self.reply(line)
