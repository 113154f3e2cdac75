"""Simulates the registers of a LabJack T7 with an LJTick-DAC, its counters and its watchdog.

Written from LabJack's documents: the Modbus map (``ljm_constants.json``), "Protocol Details [Direct
Modbus TCP]", and the T-Series Datasheet ("Digital I/O", "DIO-EF", "Watchdog"). The documents leave
open how exactly the watchdog keeps its time, and what a packet has done that is refused: here the
time is exact, and frames before the refused one have acted.
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

from rigd_sim.wire.cards.mf624_registers import Wires
from rigd_sim.wire.modbus.bank import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ILLEGAL_VALUE, Refused

LINES: Final = 23
INPUTS: Final = 14
#: Lines that can count; an encoder takes 0+1, 2+3 or 6+7 of a T7, 4+5, 6+7 or 8+9 of a T4.
COUNTING: Final = {7: (0, 1, 2, 3, 6, 7), 4: (4, 5, 6, 7, 8, 9)}
_ALL: Final = (1 << LINES) - 1
_FEEDBACK: Final = 76
_QUADRATURE, _EDGES = 10, 8
#: An input converts up to this, in V, and so finely.
_MOST_V: Final = 10.5
_STEP_V: Final = 2 * _MOST_V / 2**16
_FAILED_V: Final = -9999.0
# Errors of LabJack.
_TDAC_NOT_FOUND, _EF_PIN_TYPE_MISMATCH, _EF_ENABLED = 2764, 2553, 2566
_DEVICE_FAILURE: Final = 4


@dataclass(frozen=True, eq=False)
class _Cell:
    """One value: its type, and what reads and writes it."""

    kind: str
    read: Callable[[], float] | None = None
    write: Callable[[float], None] | None = None

    @property
    def count(self) -> int:
        return struct.calcsize(f">{self.kind}") // 2


class _Failure(Refused):
    """A refusal with an error of LabJack behind it."""

    def __init__(self, error: int) -> None:
        super().__init__(_DEVICE_FAILURE)
        self.error = error


class Watchdog:
    """The watchdog of the device, and what it does when its time is over.

    Args:
        act: brings outputs to what the registers have.
        clock_s: time.monotonic.
    """

    def __init__(self, act: Callable[[], None], clock_s: Callable[[], float]) -> None:
        self._act = act
        self._clock_s = clock_s
        self._cleared_s = clock_s()
        self.values = {
            address: 0.0
            for address in (
                61600, 61602, 61604, 61606, 61610, 61612, 61620, 61630, 61632, 61634, 61636,
                61640, 61642, 61650, 61652,
            )
        }  # fmt: skip
        self.dead = False
        self.acted = 0  #: how often
        self.written = 0  #: how often its flash memory was

    @property
    def running(self) -> bool:
        """Whether it is enabled."""
        return bool(self.values[61600])

    @property
    def strict(self) -> bool:
        """Whether nothing but its key clears it."""
        return bool(self.values[61610])

    def set(self, address: int, value: float) -> None:
        """Write one of its registers; see LabJack's description of WATCHDOG_ENABLE_DEFAULT."""
        if self.running and address != 61600:
            raise Refused(ILLEGAL_VALUE)
        self.written += 1
        self.values[address] = value
        self._cleared_s = self._clock_s()

    def clear(self, key: float) -> None:
        """Begin the time again, if the key is right."""
        if not self.strict or key == self.values[61612]:
            self._cleared_s = self._clock_s()

    def heard(self) -> None:
        """Begin the time again: something was asked."""
        if not self.strict:
            self._cleared_s = self._clock_s()

    def advance(self) -> None:
        """Act if the time is over; it then begins again."""
        now_s = self._clock_s()
        if self.running and not self.dead and now_s - self._cleared_s >= self.values[61604]:
            self.expire()

    def expire(self) -> None:
        """Act now."""
        self._cleared_s = self._clock_s()
        self.acted += 1
        self._act()


class LabjackRegisters:
    """What a client of the device reads and writes.

    Args:
        wires: what is wired to it; inputs by the number of AIN.
        lines_out: which bit of ``wires.lines_out`` a line is, by line.
        lines_in: which bit of ``wires.lines_in`` a line is, by line.
        volts_out: which of ``wires.volts_out`` an output is, by its name, such as TDAC4.
        counters: which of ``wires.counts_in`` a line counts: phase A of an encoder, or edges.
        serial: its serial number.
        clock_s: time.monotonic.
    """

    def __init__(
        self,
        wires: Wires,
        *,
        lines_out: Mapping[int, int],
        lines_in: Mapping[int, int],
        volts_out: Mapping[str, int],
        counters: Mapping[int, int],
        serial: int = 470012345,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._wires = wires
        self._lines_out, self._lines_in = lines_out, lines_in
        self._volts_out, self._counters = volts_out, counters
        self.watchdog = Watchdog(self._act, clock_s)
        self._kind = 7
        self.product = 7.0
        self.has_tick = True
        self.input_failed = False
        self.volts = dict.fromkeys(volts_out, 0.0)
        self._state = _ALL  # lines are pulled up
        self._direction = 0
        self._inhibit = 0
        self._analog = 0  #: lines that are analogue inputs (T4)
        self._error = 0
        self._enabled = dict.fromkeys(range(LINES), 0)
        self._index = dict.fromkeys(range(LINES), 0)
        self._zeros = dict.fromkeys(range(LINES), 0)
        self._settings: dict[int, float] = {}
        self._cells = self._made(serial)

    @property
    def driven(self) -> int:
        """The lines that are outputs and high, one bit each."""
        return self._state & self._direction & ~self._analog

    def advance(self) -> None:
        """Bring the device and what is wired to it to now."""
        self._wires.advance()
        self.watchdog.advance()

    def answer(self, pdu: bytes) -> bytes:
        """Return the PDU that answers ``pdu``."""
        self.advance()
        try:
            if pdu[0] == _FEEDBACK:
                answered = bytes([_FEEDBACK]) + self._feedback(pdu[1:])
            elif pdu[0] == 3 and len(pdu) == 5:
                address, count = struct.unpack(">HH", pdu[1:])
                words = self._read(address, count)
                answered = bytes((3, len(words))) + words
            else:
                raise Refused(ILLEGAL_FUNCTION)
        except Refused as refused:
            self._error = refused.error if isinstance(refused, _Failure) else 0
            return bytes([pdu[0] | 0x80, refused.code])
        finally:
            self.watchdog.heard()
        return answered

    def become_a_t4(self) -> None:
        """Have the lines and inputs of a T4, whose lines 4 to 11 are analogue at first."""
        self._kind = 4
        self.product = 4.0
        self._analog = 0xFF0
        self._cells[2880] = _Cell("I", lambda: self._analog, self._set_analog)
        for number in range(INPUTS):
            del self._cells[40000 + 2 * number], self._cells[41000 + number]

    def reset_counters(self) -> None:
        """Let all counters begin at zero again."""
        for line in self._counters:
            self._zeros[line] = self._made_at(line)

    def _feedback(self, frames: bytes) -> bytes:
        """Do the frames of one packet, and return what the reads gave."""
        answer = b""
        at = 0
        while at < len(frames):
            if len(frames) < at + 4:
                raise Refused(ILLEGAL_VALUE)
            kind, address, count = struct.unpack_from(">BHB", frames, at)
            at += 4
            if kind == 0:
                answer += self._read(address, count)
            elif kind == 1 and len(frames) >= at + 2 * count:
                self._write(address, frames[at : at + 2 * count])
                at += 2 * count
            else:
                raise Refused(ILLEGAL_VALUE)
        return answer

    def _read(self, address: int, count: int) -> bytes:
        words = b""
        while len(words) < 2 * count:
            cell = self._cells.get(address + len(words) // 2)
            if cell is None or cell.read is None:
                raise Refused(ILLEGAL_ADDRESS)
            value = cell.read()
            words += struct.pack(f">{cell.kind}", value if cell.kind == "f" else int(value))
        if len(words) != 2 * count:
            raise Refused(ILLEGAL_VALUE)
        return words

    def _write(self, address: int, words: bytes) -> None:
        cell = self._cells.get(address)
        if cell is None or cell.write is None:
            raise Refused(ILLEGAL_ADDRESS)
        if len(words) != 2 * cell.count:
            raise Refused(ILLEGAL_VALUE)
        cell.write(struct.unpack(f">{cell.kind}", words)[0])

    def _made(self, serial: int) -> dict[int, _Cell]:
        """Return the map."""
        cells = {
            2800: _Cell("I", self._levels, self._set_state),
            2850: _Cell("I", lambda: self._direction, self._set_direction),
            2900: _Cell("I", lambda: self._inhibit, self._set_inhibit),
            55000: _Cell("H", lambda: self._error),
            55100: _Cell("I", lambda: 0x00112233),
            60000: _Cell("f", lambda: self.product),
            60004: _Cell("f", lambda: 1.0292),
            60028: _Cell("I", lambda: serial),
            61614: _Cell("I", None, self.watchdog.clear),
        }
        for number in range(INPUTS):
            cells[2 * number] = _Cell("f", partial(self._converted, number))
            for first, step, kind, value in (
                (40000, 2, "f", 10.0), (41000, 1, "H", 199), (41500, 1, "H", 0),
            ):  # fmt: skip
                self._setting(cells, first + step * number, kind, value)
        for number in (0, 1):
            name = f"DAC{number}"
            cells[1000 + 2 * number] = _Cell(
                "f", partial(self._given, name), partial(self._dac, name)
            )
        for number in range(22):
            cells[30000 + 2 * number] = _Cell("f", None, partial(self._tick, f"TDAC{number}"))
        for line in range(LINES):
            cells[3000 + 2 * line] = _Cell("I", partial(self._counted, line))
            cells[44000 + 2 * line] = _Cell(
                "I", partial(self._enabled.__getitem__, line), partial(self._enable, line)
            )
            cells[44100 + 2 * line] = _Cell(
                "I", partial(self._index.__getitem__, line), partial(self._set_index, line)
            )
        for address in self.watchdog.values:
            kind = "f" if address in (61642, 61652) else "I"
            cells[address] = _Cell(
                kind,
                partial(self.watchdog.values.__getitem__, address),
                partial(self.watchdog.set, address),
            )
        return cells

    def _setting(self, cells: dict[int, _Cell], address: int, kind: str, value: float) -> None:
        """Add a register that keeps what is written."""
        self._settings[address] = value
        cells[address] = _Cell(
            kind,
            lambda: self._settings[address],
            lambda new: self._settings.__setitem__(address, new),
        )

    def _converted(self, number: int) -> float:
        if self.input_failed:
            return _FAILED_V
        volts = self._wires.volts_in.get(number, float)()
        negative = int(self._settings[41000 + number])
        if negative != 199:
            volts -= self._wires.volts_in.get(negative, float)()
        return round(min(max(volts, -_MOST_V), _MOST_V) / _STEP_V) * _STEP_V

    def _levels(self) -> int:
        levels = self.driven
        wired = self._wires.lines_in()
        for line in range(LINES):
            if not self._direction >> line & 1:
                bit = self._lines_in.get(line)
                levels |= (1 if bit is None else wired >> bit & 1) << line
        return levels

    def _set_state(self, value: float) -> None:
        self._state = self._state & self._inhibit | int(value) & ~self._inhibit & _ALL
        self._drive()

    def _set_direction(self, value: float) -> None:
        self._direction = self._direction & self._inhibit | int(value) & ~self._inhibit & _ALL
        self._drive()

    def _set_analog(self, value: float) -> None:
        self._analog = self._analog & self._inhibit | int(value) & ~self._inhibit & _ALL

    def _set_inhibit(self, value: float) -> None:
        self._inhibit = int(value) & _ALL

    def _drive(self) -> None:
        driven = self.driven
        self._wires.lines_out(
            sum(1 << bit for line, bit in self._lines_out.items() if driven >> line & 1)
        )

    def _give(self, name: str, volts: float) -> None:
        if not math.isfinite(volts):
            raise Refused(ILLEGAL_VALUE)
        if name in self._volts_out:
            self.volts[name] = volts
            wire = self._wires.volts_out.get(self._volts_out[name])
            if wire is not None:
                wire(volts)

    def _given(self, name: str) -> float:
        return self.volts.get(name, 0.0)

    def _dac(self, name: str, volts: float) -> None:
        self._give(name, min(max(volts, 0.0), 5.0))

    def _tick(self, name: str, volts: float) -> None:
        if not self.has_tick or name not in self._volts_out:
            raise _Failure(_TDAC_NOT_FOUND)
        self._give(name, min(max(volts, -10.0), 10.0))

    def _made_at(self, line: int) -> int:
        return self._wires.counts_in.get(self._counters[line], int)()

    def _counted(self, line: int) -> int:
        if not self._enabled[line] or line not in self._counters:
            return 0
        return self._made_at(line) - self._zeros[line] & 0xFFFF_FFFF

    def _set_index(self, line: int, index: float) -> None:
        if self._enabled[line]:
            raise _Failure(_EF_ENABLED)
        if line not in COUNTING[self._kind] or index not in (0, _QUADRATURE, _EDGES):
            raise _Failure(_EF_PIN_TYPE_MISMATCH)
        self._index[line] = int(index)

    def _enable(self, line: int, enabled: float) -> None:
        if enabled and line in self._counters:
            self._zeros[line] = self._made_at(line)
        self._enabled[line] = int(enabled)

    def _act(self) -> None:
        """Bring the outputs to what the registers of the watchdog have."""
        values = self.watchdog.values
        if values[61630]:
            left = int(values[61636])
            self._state = self._state & left | int(values[61632]) & ~left & _ALL
            self._direction = self._direction & left | int(values[61634]) & ~left & _ALL
            self._drive()
        for number, enable in ((0, 61640), (1, 61650)):
            if values[enable]:
                self._give(f"DAC{number}", values[enable + 2])
