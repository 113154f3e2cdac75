"""A power supply with the commands of the Keithley 2260B, on a TCP port, and how it fails.

Source: Keithley 2260B programming manual, `OUTPut`, `SOURce:VOLTage`, `MEASure`. It shares no code
with PyMeasure, and stands on the supply of `support.written_drivers`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import overload

from support.written_drivers import supply_class

from rigd.sdk.check import SentReading

#: Faults that it shows, by the names of `rigd.sdk.check`.
FAULTS = ("dead", "silent", "late", "garbled", "stuck", "locked")


class Voltages(Sequence[SentReading]):
    """The voltage of each reading alone: who asks for the current asks later."""

    def __init__(self, readings: Sequence[SentReading]) -> None:
        self._readings = readings

    def __len__(self) -> int:
        return len(self._readings)

    @overload
    def __getitem__(self, index: int) -> SentReading: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[SentReading]: ...
    def __getitem__(self, index: int | slice) -> SentReading | Sequence[SentReading]:
        if isinstance(index, slice):
            return [self[number] for number in range(*index.indices(len(self)))]
        taken_s, values = self._readings[index]
        return SentReading(taken_s, {"voltage": values["voltage"]})


class Supply2260B(supply_class()):  # type: ignore[misc]  # made of a template
    """The supply; ``address`` is its VISA resource."""

    def __init__(self) -> None:
        super().__init__()
        self.heard: list[str] = []
        self.address = f"TCPIP::127.0.0.1::{self.port.rpartition(':')[2]}::SOCKET"

    def _command(self, command: str) -> str | None:
        self.heard.append(command)
        name, _, value = command.upper().partition(" ")
        match name:
            case "OUTPUT":
                return self._base_command(f"OUTP {'ON' if value == '1' else 'OFF'}")
            case "OUTPUT?":
                return self._base_command("OUTP?")
            case "SOUR:VOLT":
                return self._base_command(f"VOLT {value}")
            case "SOUR:VOLT?":
                return f"{self.volts:.4f}"
        return self._base_command(command)

    def _base_command(self, command: str) -> str | None:
        found: str | None = super()._command(command)
        return found
