"""Simulates a speed drive on Modbus with its registers and a communication watchdog."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import ClassVar

from rigd_sim.wire.modbus.bank import ILLEGAL_VALUE, Bank, Refused
from rigd_sim.wire.modbus.line import Line
from rigd_sim.wire.modbus.part import LINE_FAULTS, ModbusPart, Ticker
from rigd_sim.wire.part import State

_RPM = 2 * math.pi / 60
#: How often a drive looks at what has been written, in s. Drives do so every 2 to 50 ms.
_SCAN_S = 20e-3


class Drive(ABC):
    """The behaviour that all drives share: enable, trip, reset, communication watchdog.

    A drive acts on what has been written once per scan, in :meth:`tick`: what is overwritten before
    that, it never sees.

    ``command`` is called with the speed in rad/s that the motor shall turn at and whether it has
    torque, whenever one changes; ``speed`` is the rate at which it turns.
    """

    #: Fault codes of the drive for a silent line and for too much current.
    silence_code: ClassVar[int]
    overcurrent_code: ClassVar[int]

    def __init__(
        self,
        command: Callable[[float, bool], None],
        speed: Callable[[], float],
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._speed = speed
        self.enabled = False
        self.fault_code = 0
        self.last_code = 0
        self.setpoint = 0.0
        self.trips = 0  #: how often its watchdog has acted
        self.watchdog_s = 0.0  #: 0: off
        self.watches = True  #: False: the watchdog is broken
        self.keeps = True  #: False: what is written to the watchdog is not kept
        self.stuck = False  #: True: it goes on as it was
        self.locked = False  #: True: its enable input is open
        self.held = False  #: True: its motor is held fast
        self.elsewhere = False  #: True: its setpoint comes from elsewhere, and stands still
        self._command = command
        self._commanded = (0.0, False)
        self._now = now
        self._heard: float | None = None  # it watches from the first request on
        self.safe_since_ns = time.monotonic_ns()  #: CLOCK_MONOTONIC; 0 while it is enabled

    def heard(self) -> None:
        """Note that a request has come."""
        self._heard = self._now()

    def tick(self) -> None:
        """Act on what has been written; trip when the line has been silent for too long."""
        if self.stuck:
            return
        self.scan()
        self.apply()
        if self._heard is None or self.fault_code or not self.watches:
            return
        if 0 < self.watchdog_s < self._now() - self._heard:
            self.trips += 1
            self.trip(self.silence_code)

    def trip(self, code: int) -> None:
        """Go to the fault state: no torque."""
        self.fault_code = self.last_code = code
        self.enabled = False
        self.apply()

    def reset(self) -> None:
        """Leave the fault state, disabled."""
        self.fault_code = 0

    def apply(self) -> None:
        """Command the motor, and note since when it is without torque."""
        if self.enabled or not self.safe_since_ns:
            self.safe_since_ns = 0 if self.enabled else time.monotonic_ns()
        asked = self._commanded[0] if self.elsewhere else self.setpoint
        wanted = (asked if self.enabled and not self.held else 0.0, self.enabled)
        if wanted != self._commanded:
            self._commanded = wanted
            self._command(*wanted)

    def set_speed(self, word: int) -> None:
        """Take a signed speed in rev/min."""
        self.setpoint = (word - 0x10000 if word & 0x8000 else word) * _RPM

    def speed(self) -> float:
        """Return the actual speed in rad/s."""
        return 0.0 if self.held else self._speed()

    def rpm(self) -> float:
        """Return the actual speed in rev/min."""
        return self.speed() / _RPM

    @abstractmethod
    def scan(self) -> None:
        """Act on the command that stands in its register."""

    @abstractmethod
    def bank(self) -> Bank:
        """Return its registers."""


class Altivar(Drive):
    """Schneider Altivar 320: the DRIVECOM (CiA 402) state chart in CMD and ETA."""

    silence_code = 5  # SLF1, Modbus communication interruption
    overcurrent_code = 9  # OCF
    #: CMD bits 0 to 3 -> ETA of the state they lead to (voltage enabled, bit 4, always).
    _STATES: Mapping[int, int] = {0x6: 0x0231, 0x7: 0x0233, 0xF: 0x0237}
    _DISABLED = 0x0250
    _FAULT = 0x0218

    def __init__(
        self,
        command: Callable[[float, bool], None],
        speed: Callable[[], float],
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(command, speed, now)
        self._cmd = self._seen = 0
        self._eta = self._DISABLED
        self._reaction = 1
        self._tto = 100  # 10 s
        self.watchdog_s = 10.0

    def bank(self) -> Bank:
        """See :class:`Drive`."""
        bank = Bank(max_registers=63)
        bank.number(3201, "uint16", lambda: self._FAULT if self.fault_code else self._eta)
        bank.number(6005, "uint16", lambda: self._tto)
        bank.writable(6005, self._write_tto)
        bank.number(7010, "uint16", lambda: self._reaction)
        bank.writable(7010, self._write_reaction)
        bank.number(7121, "uint16", lambda: self.last_code)
        bank.number(8501, "uint16", lambda: self._cmd)
        bank.writable(8501, self._write_cmd)
        bank.number(8602, "int16", lambda: self.setpoint / _RPM)
        bank.writable(8602, self.set_speed)
        bank.number(8604, "int16", self.rpm)
        return bank

    def trip(self, code: int) -> None:
        """See :class:`Drive`."""
        super().trip(code)
        self._eta = self._DISABLED

    def _write_tto(self, word: int) -> None:
        if not 1 <= word <= 300:
            raise Refused(ILLEGAL_VALUE)
        if self.keeps:
            self._tto = word
            self._arm_watchdog()

    def _write_reaction(self, word: int) -> None:
        if self.keeps:
            self._reaction = word
            self._arm_watchdog()

    def _arm_watchdog(self) -> None:
        self.watchdog_s = self._tto * 0.1 if self._reaction else 0.0

    def _write_cmd(self, word: int) -> None:
        self._cmd = word

    def scan(self) -> None:
        """See :class:`Drive`."""
        word = self._cmd
        risen, self._seen = word & ~self._seen, word
        if risen & 0x80:
            self.reset()
        if self.fault_code:
            return
        chart = [self._DISABLED, *self._STATES.values()]
        wanted = self._STATES.get(word & 0xF, self._DISABLED)
        if chart.index(wanted) <= chart.index(self._eta) + 1:  # one step up, any number down
            self._eta = wanted
        if self.locked and self._eta == self._STATES[0xF]:
            self._eta = self._STATES[0x7]
        self.enabled = self._eta == self._STATES[0xF]


class Asda(Drive):
    """Delta ASDA-B: digital inputs set over the line, speed register 1."""

    silence_code = 20  # ALE20
    overcurrent_code = 1  # ALE01
    _SON, _ARST, _SPD0 = 1, 2, 4
    #: Parameters with other than factory values, as the map needs them.
    _SETTINGS: Mapping[int, int] = {
        0x0101: 2, 0x020A: 0x0101, 0x020B: 0x0102, 0x020C: 0x0114, 0x0212: 0x0102,
    }  # fmt: skip

    def __init__(
        self,
        command: Callable[[float, bool], None],
        speed: Callable[[], float],
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(command, speed, now)
        self._by_line = self._inputs = self._stops = self._time = 0
        self._auxiliary = 0
        self.stored = 0  #: writes to its memory, which bears 100 000 or so

    def bank(self) -> Bank:
        """See :class:`Drive`."""
        bank = Bank(max_registers=10, functions=frozenset({3, 6, 16}))
        for address, word in self._SETTINGS.items():
            bank.constant(address, word)
        bank.number(0x0001, "uint16", lambda: self.fault_code)
        bank.number(0x0004, "int16", self.rpm)
        bank.writable(0x0004, lambda word: None)
        bank.number(0x0109, "int16", lambda: self.setpoint / _RPM)
        bank.writable(0x0109, self.set_speed)
        bank.number(0x021E, "uint16", lambda: self._auxiliary)
        bank.writable(0x021E, self._write_auxiliary)
        bank.number(0x0303, "uint16", lambda: self._stops)
        bank.writable(0x0303, self._write_stops)
        bank.number(0x0304, "uint16", lambda: self._time)
        bank.writable(0x0304, self._write_time)
        bank.number(0x0306, "uint16", lambda: self._by_line)
        bank.writable(0x0306, self._write_by_line)
        bank.number(0x0407, "uint16", lambda: self._inputs)
        bank.writable(0x0407, self._write_inputs)
        bank.number(0x0409, "uint16", lambda: self.enabled)
        return bank

    def set_speed(self, word: int) -> None:
        """See :class:`Drive`; stored, unless that was switched off (P2-30 = 5)."""
        self.stored += self._auxiliary != 5
        super().set_speed(word)

    def _write_auxiliary(self, word: int) -> None:
        self._auxiliary = word

    def _write_stops(self, word: int) -> None:
        self._stops = word
        self._arm_watchdog()

    def _write_time(self, word: int) -> None:
        if word > 20:
            raise Refused(ILLEGAL_VALUE)
        if self.keeps:
            self._time = word
            self._arm_watchdog()

    def _arm_watchdog(self) -> None:
        self.watchdog_s = float(self._time) if self._stops else 0.0

    def _write_by_line(self, word: int) -> None:
        self._by_line = word

    def _write_inputs(self, word: int) -> None:
        self._inputs = word & self._by_line

    def scan(self) -> None:
        """See :class:`Drive`."""
        if self._inputs & self._ARST:
            self.reset()
        enabled = self._inputs & self._SON and not self.locked
        self.enabled = bool(enabled) and not self.fault_code


#: Drives it can stand for.
DRIVES: Mapping[str, type[Drive]] = {"delta-asda-b": Asda, "schneider-atv320": Altivar}


class SimModbusServo(ModbusPart):
    """A speed drive of one of :data:`DRIVES`; see :class:`Drive` for the physics."""

    faults = LINE_FAULTS | {
        "watchdog_tripped": "trips as if its line had been silent, once",
        "watchdog_dead": "never trips when its line falls silent",
        "watchdog_unset": "takes what is written to its watchdog, and does not keep it",
        "overcurrent": "trips by too much current, once",
        "stuck": "answers, and goes on as it was: it obeys no command, setpoint or watchdog",
        "locked": "its enable input is open: it is not enabled, and no longer if it was",
        "blocked": "its motor is held fast, and does not turn",
        "setpoint_ignored": "keeps the speed that it has, as one set to take it from elsewhere",
    }

    def __init__(
        self,
        name: str,
        line: Line,
        *,
        command: Callable[[float, bool], None],
        speed: Callable[[], float],
        unit: int = 1,
        drive: str = "schneider-atv320",
        scan_s: float = _SCAN_S,
    ) -> None:
        if drive not in DRIVES:
            raise ValueError(f"no drive {drive!r}; known: {', '.join(DRIVES)}")
        self._drive = DRIVES[drive](command, speed)
        super().__init__(name, line, unit, self._drive.bank())
        self._ticker = Ticker(scan_s, self._drive.tick)

    async def start(self) -> str:
        """See :class:`ModbusPart`."""
        where = await super().start()
        self._ticker.start()
        return where

    async def stop(self) -> None:
        """See :class:`ModbusPart`."""
        self._ticker.stop()
        await super().stop()

    def state(self) -> State:
        """Return what its display shows; speeds in rad/s."""
        drive = self._drive
        return {
            "enabled": drive.enabled,
            "fault_code": drive.fault_code,
            "setpoint": drive.setpoint,
            "speed": drive.speed(),
            "watchdog_s": drive.watchdog_s,
            "trips": drive.trips,
            "safe_since_ns": drive.safe_since_ns,
            "asked": self.asked,
        }

    def heard(self) -> None:
        """See :class:`ModbusPart`."""
        self._drive.heard()

    def show(self, fault: str) -> bool:
        """See :class:`ModbusPart`."""
        match fault:
            case "watchdog_tripped":
                self._drive.trip(self._drive.silence_code)
            case "overcurrent":
                self._drive.trip(self._drive.overcurrent_code)
            case "watchdog_dead":
                self._drive.watches = False
            case "watchdog_unset":
                self._drive.keeps = False
            case "stuck":
                self._drive.stuck = True
            case "locked":
                self._drive.locked = True
            case "blocked":
                self._drive.held = True
            case "setpoint_ignored":
                self._drive.elsewhere = True
            case _:
                return False
        return True

    def cleared(self, fault: str | None) -> None:
        """See :class:`ModbusPart`; a drive that has tripped must be reset over its line."""
        if fault in (None, "watchdog_dead"):
            self._drive.watches = True
        if fault in (None, "watchdog_unset"):
            self._drive.keeps = True
        if fault in (None, "stuck"):
            self._drive.stuck = False
        if fault in (None, "locked"):
            self._drive.locked = False
        if fault in (None, "blocked"):
            self._drive.held = False
        if fault in (None, "setpoint_ignored"):
            self._drive.elsewhere = False
