"""Simulates a Modbus device: its registers, its connection and its faults."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from rigd_sim.wire.modbus.bank import Bank
from rigd_sim.wire.modbus.frames import Ask
from rigd_sim.wire.modbus.line import Line, Pieces
from rigd_sim.wire.part import Part

_BUSY = 6

#: Faults of the line: name, and what it does.
LINE_FAULTS = {
    "silent": "receives and obeys, and does not answer",
    "deaf": "is still connected, and neither receives nor answers (a half-open connection)",
    "late": "answers 'delay_s' (0.15) too late",
    "wrong_unit": "answers as another unit",
    "wrong_transaction": "answers with a transaction number never asked with (TCP)",
    "wrong_function": "answers to another function",
    "exception": "refuses with exception 'code' (4)",
    "busy": "refuses with exception 6: busy",
    "crc": "answers with a wrong check sum (RTU)",
    "truncated": "stops in the middle of its answer",
    "garbage": "sends bytes of noise before its answer",
    "byte_gap": "pauses for 'delay_s' (0.15) in the middle of its answer",
    "cut": "is gone, for good: its connection is reset (TCP), or its port is lost (RTU)",
}
_ONLY_TCP = {"wrong_transaction"}
_ONLY_SERIAL = {"crc"}
_OPTIONS = {"delay_s": 0.15, "code": 4, "count": None}


@dataclass
class _Fault:
    delay_s: float
    code: int
    count: int | None  #: answers it spoils before it is over; None until cleared


class ModbusPart(Part):
    """One device on a line of its own; several faults may be shown together.

    Every fault takes ``count``, the number of answers it spoils (all, unless given).
    """

    faults: ClassVar[dict[str, str]] = LINE_FAULTS

    def __init__(self, name: str, line: Line, unit: int, bank: Bank) -> None:
        self.name = name
        self.line = line
        self.unit = unit
        self.bank = bank
        self.asked = 0
        self._shown: dict[str, _Fault] = {}

    async def start(self) -> str:
        """See :class:`Part`."""
        return f"{self.name}: {await self.line.start(self._handle)}, unit {self.unit}"

    async def stop(self) -> None:
        """See :class:`Part`."""
        await self.line.stop()

    def inject(self, fault: str, **options: Any) -> None:
        """See :class:`Part`."""
        only = _ONLY_SERIAL if not self.line.is_serial else _ONLY_TCP
        known = [name for name in self.faults if name not in only]
        if fault not in known:
            raise ValueError(
                f"{self.name} has no fault {fault!r} here; it knows {', '.join(known)}"
            )
        unknown = set(options) - set(_OPTIONS)
        if unknown:
            raise ValueError(
                f"fault {fault!r} of {self.name} has no option {min(unknown)!r}; "
                f"it knows {', '.join(_OPTIONS)}"
            )
        if fault == "cut":
            self.line.cut()
        elif not self.show(fault):
            self._shown[fault] = _Fault(**{**_OPTIONS, **options})

    def clear(self, fault: str | None = None) -> None:
        """See :class:`Part`."""
        for each in list(self._shown) if fault is None else [fault]:
            self._shown.pop(each, None)
        self.cleared(fault)

    def show(self, fault: str) -> bool:
        """Show a fault of the device's own; False if it is one of the line's."""
        return False

    def cleared(self, fault: str | None) -> None:
        """Stop showing a fault of the device's own, or all."""

    def heard(self) -> None:
        """Note that a request for this device has come: it feeds a watchdog."""

    def _handle(self, ask: Ask) -> Pieces:
        if ask.unit != self.unit or self._has("deaf"):
            return []
        self.asked += 1
        self.heard()
        pdu = self.bank.answer(ask.pdu)
        if (fault := self._take("exception")) is not None:
            pdu = bytes([ask.pdu[0] | 0x80, fault.code])
        if self._has("busy"):
            pdu = bytes([ask.pdu[0] | 0x80, _BUSY])
        return self._spoil(ask, pdu)

    def _spoil(self, ask: Ask, pdu: bytes) -> Pieces:
        unit = self.unit ^ 0x10 if self._has("wrong_unit") else self.unit
        transaction = ask.transaction ^ (0x8000 if self._has("wrong_transaction") else 0)
        if self._has("wrong_function"):
            pdu = bytes([pdu[0] ^ 0x07]) + pdu[1:]
        frame = self.line.frame(unit, pdu, transaction)
        if self._has("crc"):
            frame = frame[:-1] + bytes([frame[-1] ^ 0x40])
        if self._has("truncated"):
            frame = frame[: len(frame) // 2]
        if self._has("garbage"):
            frame = b"\x55\xaa\x07" + frame
        delayed, paused = self._take("late"), self._take("byte_gap")
        start_s = 0.0 if delayed is None else delayed.delay_s
        if self._has("silent"):
            return []
        if paused is None:
            return [(start_s, frame)]
        middle = len(frame) // 2
        return [(start_s, frame[:middle]), (paused.delay_s, frame[middle:])]

    def _has(self, fault: str) -> bool:
        return self._take(fault) is not None

    def _take(self, fault: str) -> _Fault | None:
        shown = self._shown.get(fault)
        if shown is not None and shown.count is not None:
            shown.count -= 1
            if shown.count <= 0:
                del self._shown[fault]
        return shown


class Ticker:
    """Calls ``tick`` on the event loop every ``period_s``, until stopped."""

    def __init__(self, period_s: float, tick: Callable[[], None]) -> None:
        self._period_s = period_s
        self._tick = tick
        self._timer: asyncio.TimerHandle | None = None

    def start(self) -> None:
        """Begin."""
        self._timer = asyncio.get_running_loop().call_later(self._period_s, self._again)

    def stop(self) -> None:
        """End; ending twice is silent."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _again(self) -> None:
        self.start()
        self._tick()
