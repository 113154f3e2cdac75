"""Simulates a load-cell transmitter on Modbus: a converter with noise, a filter, and registers."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from rigd_sim.wire.modbus.bank import ILLEGAL_VALUE, Bank, Refused
from rigd_sim.wire.modbus.line import Line
from rigd_sim.wire.modbus.part import LINE_FAULTS, ModbusPart
from rigd_sim.wire.part import State

#: The converter's rate, in Hz, and conversions made up for at most after a pause.
_RATE_HZ = 300.0
_MOST_CONVERSIONS = 1000
#: The weight is stable while it has moved by less than so many noise deviations plus counts.
_STABLE_DEVIATIONS = 6.0


class LoadCell:
    """Converts the force to a reading: noise, a first-order filter, tare, zero.

    Forces in N. ``resolution`` is one count.
    """

    def __init__(
        self,
        force: Callable[[], float],
        *,
        capacity: float,
        resolution: float,
        noise: float = 0.0,
        filter_s: float = 0.0,
        seed: int = 0,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self.capacity = capacity
        self.resolution = resolution
        self.broken = False
        self.frozen = False
        self._force = force
        self._noise = noise
        self._keep = math.exp(-1.0 / (_RATE_HZ * filter_s)) if filter_s > 0 else 0.0
        self._random = np.random.default_rng(seed)
        self._now = now
        self._next = now()
        self._filtered = force()
        self._moved = 0.0
        self._zero = self._tare = 0.0

    def gross(self) -> float:
        """Return the force less the zero, in N."""
        self._convert()
        return self._filtered - self._zero

    def net(self) -> float:
        """Return the force less zero and tare, in N."""
        return self.gross() - self._tare

    @property
    def stable(self) -> bool:
        """Whether it stands still."""
        self._convert()
        return self._moved <= _STABLE_DEVIATIONS * self._noise + 2 * self.resolution

    @property
    def overloaded(self) -> bool:
        """Whether the cell bears more than 110 % of its capacity."""
        return abs(self.gross()) > 1.1 * self.capacity

    def tare(self) -> None:
        """Set the net force to zero."""
        self._tare = self.gross()

    def untare(self) -> None:
        """Show the gross force as net."""
        self._tare = 0.0

    def zero(self) -> None:
        """Set the gross force to zero."""
        self._zero += self.gross()

    def _convert(self) -> None:
        """Make the conversions that are due, from the force as it is now."""
        now = self._now()
        due = int((now - self._next) * _RATE_HZ) + 1
        if due <= 0:
            return
        self._next += due / _RATE_HZ
        if self.frozen:
            return
        for _ in range(min(due, _MOST_CONVERSIONS)):
            reading = self._force() + self._noise * float(self._random.standard_normal())
            self._moved = abs(reading - self._filtered)
            self._filtered += (1.0 - self._keep) * (reading - self._filtered)


def laumas_tlb4(cell: LoadCell) -> Bank:
    """Return the registers of a Laumas TLB4: magnitudes, their signs in the status register."""
    bank = Bank(max_registers=32, functions=frozenset({3, 16}))

    def gross() -> float:
        return cell.gross() / cell.resolution

    def net() -> float:
        return cell.net() / cell.resolution

    def status() -> int:
        over = cell.overloaded
        return (
            cell.broken
            | over << 2
            | over << 3
            | (round(gross()) < 0) << 7
            | (round(net()) < 0) << 8
            | cell.stable << 11
        )

    def command(value: int) -> None:
        commands = {0: lambda: None, 7: cell.tare, 8: cell.zero, 9: cell.untare}
        if value not in commands:
            raise Refused(ILLEGAL_VALUE)
        commands[value]()

    for address, value in enumerate((105, 4, 2024, 1234, 1)):  # firmware, type, year, serial
        bank.constant(address, value)
    bank.constant(5, 0)
    bank.writable(5, command)
    bank.number(6, "uint16", status)
    bank.number(7, "uint32", lambda: abs(gross()))
    bank.number(9, "uint32", lambda: abs(net()))
    bank.number(11, "uint32", lambda: abs(net()))
    return bank


def seneca_z_sg2(cell: LoadCell) -> Bank:
    """Return the registers of a Seneca Z-SG2 set to newtons: floats."""
    bank = Bank()
    for address, value in enumerate((0x2B, 0x0100, 0x0500)):  # machine, firmware, unit N
        bank.constant(address, value)
    bank.number(63, "float32", cell.net)
    bank.number(
        77, "uint16", lambda: cell.overloaded << 1 | (cell.net() < 0) << 2 | cell.stable << 4
    )
    return bank


def tuna_id551(cell: LoadCell) -> Bank:
    """Return the registers of scale 1 of a Tuna ID551PN: floats, edges for commands."""
    bank = Bank()
    held = 0

    def demand(value: int) -> None:
        nonlocal held
        risen, held = value & ~held, value
        for bit, do in ((11, cell.zero), (12, cell.tare), (13, cell.untare)):
            if risen >> bit & 1:
                do()

    def status() -> int:
        under = cell.gross() < -0.2 * cell.capacity
        return (
            under << 9 | cell.overloaded << 10 | (not cell.stable) << 12 | (not cell.broken) << 15
        )

    bank.number(0, "float32", cell.net)
    bank.number(2, "float32", cell.gross)
    bank.number(4, "uint16", status)
    bank.number(5, "uint16", lambda: held)
    bank.writable(5, demand)
    return bank


#: Instruments it can stand for.
INSTRUMENTS = {
    "laumas-tlb4": laumas_tlb4,
    "seneca-z-sg2": seneca_z_sg2,
    "tuna-id551": tuna_id551,
}


class SimModbusTransmitter(ModbusPart):
    """A load-cell transmitter of one of :data:`INSTRUMENTS`.

    ``cell`` is a :class:`LoadCell`, its ``force`` is the physics.
    """

    faults = LINE_FAULTS | {
        "word_order": "sends the words of 32-bit numbers the other way round",
        "frozen": "shows the same value for ever",
        "broken": "reports that its cell is broken",
    }

    def __init__(
        self,
        name: str,
        line: Line,
        cell: LoadCell,
        *,
        unit: int = 1,
        instrument: str = "laumas-tlb4",
    ) -> None:
        if instrument not in INSTRUMENTS:
            raise ValueError(f"no instrument {instrument!r}; known: {', '.join(INSTRUMENTS)}")
        super().__init__(name, line, unit, INSTRUMENTS[instrument](cell))
        self._cell = cell

    def state(self) -> State:
        """Return what its display shows."""
        return {
            "gross": self._cell.gross(),
            "net": self._cell.net(),
            "stable": self._cell.stable,
            "asked": self.asked,
        }

    def show(self, fault: str) -> bool:
        """See :class:`ModbusPart`."""
        return self._set(fault, True)

    def cleared(self, fault: str | None) -> None:
        """See :class:`ModbusPart`."""
        for each in ("word_order", "frozen", "broken") if fault is None else (fault,):
            self._set(each, False)

    def _set(self, fault: str, shown: bool) -> bool:
        match fault:
            case "word_order":
                self.bank.swapped = shown
            case "frozen":
                self._cell.frozen = shown
            case "broken":
                self._cell.broken = shown
            case _:
                return False
        return True
