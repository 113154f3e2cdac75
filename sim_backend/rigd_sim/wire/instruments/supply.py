"""Simulates a programmable supply that takes its voltage in lines, as SCPI has them.

Commands (SCPI-1999, volume 2, 15 and 19): `OUTP ON|OFF`, `OUTP?`, `VOLT number`, `MEAS:VOLT?`,
`MEAS:CURR?`, `*IDN?`; several stand in a line, with semicolons between them. It has no watchdog.
"""

from __future__ import annotations

import re
import time
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar, Final

from rigd_sim.wire.part import State
from rigd_sim.wire.serial_part import PORT_FAULTS, WIRE_FAULTS, SerialPart

_VOLTS: Final = re.compile(r"VOLT (\d+(?:\.\d*)?)")


class SimSupply(SerialPart):
    """A supply on a pty, with a resistor at its output."""

    faults: ClassVar[Mapping[str, str]] = {
        **WIRE_FAULTS,
        "stuck": "answers, and goes on as it was: it obeys no command",
        "locked": "its output is not switched on, and goes off if it was on",
        "setpoint_ignored": "keeps the voltage that it has",
        "tripped": "its protection switches the output off, once",
        "comma": "numbers have a decimal comma",
        **PORT_FAULTS,
    }

    def __init__(
        self,
        name: str,
        path: Path,
        *,
        highest: float = 30.0,
        resistance: float = 10.0,
        identity: str = "rigd,simulated supply,1,1.0",
        baud: int = 9600,
        seed: int = 0,
    ) -> None:
        super().__init__(name, path, baud=baud, seed=seed, end=b"\n")
        self._highest = highest
        self._resistance = resistance
        self._identity = identity
        self._volts = 0.0  # as set
        self._on = False
        self._ordered = (0.0, False)  # what the commands made of voltage and output
        self._safe_since_ns = self._given_since_ns = time.monotonic_ns()
        self.sent = 0  #: answers, each counted before it is sent

    async def start(self) -> str:
        """Open the pty; see :meth:`Part.start`."""
        self.plug_in()
        return f"{self.name}: supply at {self.path}"

    @property
    def volts(self) -> float:
        """What stands at its output, in V."""
        return self._volts if self._on else 0.0

    def state(self) -> State:
        """Return what stands at its output, and since when (CLOCK_MONOTONIC, in ns).

        ``safe_since_ns`` is 0 while the output is on.
        """
        return {
            "output": self._on,
            "set_voltage": self._volts,
            "voltage": self.volts,
            "current": self.volts / self._resistance,
            "sent": self.sent,
            "plugged_in": self.plugged_in,
            "safe_since_ns": self._safe_since_ns,
            "given_since_ns": self._given_since_ns,
            "faults": ", ".join(self._active),
        }

    def show(self, fault: str) -> None:
        """Show a fault of the supply; see :class:`SerialPart`."""
        if fault == "tripped":
            del self._active[fault]
        if fault in ("tripped", "locked"):
            self._set(self._volts, on=False)

    def cleared(self) -> None:
        """Do what was commanded while it was stuck."""
        volts, on = self._ordered
        self._set(volts, on=on)

    def on_command(self, command: bytes) -> None:
        """Obey the commands of a line, and send the answers to its questions in one line."""
        answers = []
        for item in command.decode("latin-1").split(";"):
            answers += self._obey(item.strip().lstrip(":").upper())
        if answers:
            self.sent += 1
            text = ";".join(answers)
            if self.shown("comma") is not None:
                text = text.replace(".", ",")
            self.reply(text.encode("latin-1"))

    def _obey(self, item: str) -> list[str]:
        match item:
            case "*IDN?":
                return [self._identity]
            case "OUTP?":
                return [str(int(self._on))]
            case "MEAS:VOLT?":
                return [f"{self.volts:.4f}"]
            case "MEAS:CURR?":
                return [f"{self.volts / self._resistance:.4f}"]
            case "OUTP ON":
                self._set(self._ordered[0], on=self.shown("locked") is None)
            case "OUTP OFF":
                self._set(self._ordered[0], on=False)
            case _ if (match := _VOLTS.fullmatch(item)) and float(match[1]) <= self._highest:
                if self.shown("setpoint_ignored") is None:
                    self._set(float(match[1]), on=self._ordered[1])
        return []  # what it does not understand has no answer

    def _set(self, volts: float, *, on: bool) -> None:
        self._ordered = (volts, on)
        if self.shown("stuck") is not None:
            return
        before, t_ns = self.volts, time.monotonic_ns()
        if on != self._on:
            self._safe_since_ns = 0 if on else t_ns
        self._volts, self._on = volts, on
        if self.volts != before:
            self._given_since_ns = t_ns
