"""A drive on a Modbus server of others that looks at its command word once per scan.

It has the registers of an Altivar 320 (NVE41308, NVE41316) and is written without rigd's own
simulated drive.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, Final, Protocol

from pyModbusTCP.server import DataBank, ModbusServer

CMD, ETA, LFRD, RFRD, SLL, TTO, LFT = 8501, 3201, 8602, 8604, 7010, 6005, 7121
_READY, _SWITCHED_ON, _ENABLED, _DISABLED, _FAULT = 0x0231, 0x0233, 0x0237, 0x0250, 0x0218
_SLF1 = 5
#: Its registers are below this address.
REGISTERS: Final = 10_000


class Bank(Protocol):
    """The holding registers of a server."""

    at: float  #: when a master asked last, by ``time.monotonic``; 0: never

    def word(self, address: int) -> int:
        """Return a register."""

    def show(self, address: int, word: int) -> None:
        """Set a register."""


class Scanner:
    """The drive, in a thread from :meth:`start` until :meth:`stop`; its motor turns as commanded.

    ``moved`` is called with whether it is enabled and its speed in rpm when these change.
    """

    def __init__(
        self, bank: Bank, scan_s: float, moved: Callable[[bool, int], object] = lambda *_: None
    ) -> None:
        self._bank = bank
        self._scan_s = scan_s
        self._moved = moved
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._seen = 0
        bank.show(ETA, _DISABLED)
        bank.show(TTO, 100)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._ended.set()
        self._thread.join()

    def trip(self) -> None:
        self._bank.show(LFT, _SLF1)
        self._bank.show(ETA, _FAULT)

    def _run(self) -> None:
        while not self._ended.wait(self._scan_s):
            self._scan()

    def _scan(self) -> None:
        bank = self._bank
        before = bank.word(ETA) == _ENABLED, bank.word(RFRD)
        command, state = bank.word(CMD), bank.word(ETA)
        risen, self._seen = command & ~self._seen, command
        silent_s = time.monotonic() - bank.at
        if state == _FAULT:
            state = _DISABLED if risen & 0x80 else _FAULT
        elif bank.at and bank.word(SLL) and silent_s > 0.1 * bank.word(TTO):
            bank.show(LFT, _SLF1)
            state = _FAULT
        elif command & 0xF == 0x6:
            state = _READY
        elif command & 0xF == 0x7 and state in (_READY, _ENABLED):
            state = _SWITCHED_ON
        elif command & 0xF == 0xF and state == _SWITCHED_ON:
            state = _ENABLED
        elif not command & 0x2:
            state = _DISABLED
        rpm = bank.word(LFRD) if state == _ENABLED else 0
        bank.show(ETA, state)
        bank.show(RFRD, rpm)
        if (state == _ENABLED, rpm) != before:
            self._moved(state == _ENABLED, rpm)


class _Heard(DataBank):  # type: ignore[misc]  # the package has no types
    def __init__(self) -> None:
        super().__init__(h_regs_size=REGISTERS)
        self.at = 0.0

    def get_holding_registers(
        self, address: int, number: int = 1, srv_info: Any = None
    ) -> list[int] | None:
        if srv_info is not None:
            self.at = time.monotonic()
        words: list[int] | None = super().get_holding_registers(address, number, srv_info)
        return words

    def word(self, address: int) -> int:
        (word,) = super().get_holding_registers(address) or (0,)
        return word

    def show(self, address: int, word: int) -> None:
        self.set_holding_registers(address, [word])


class ScannedDrive:
    """The drive on pyModbusTCP's server."""

    def __init__(
        self,
        scan_s: float,
        moved: Callable[[bool, int], object] = lambda *_: None,
        port: int = 0,
    ) -> None:
        self.bank = _Heard()
        self._server = ModbusServer("127.0.0.1", port, no_block=True, data_bank=self.bank)
        self._scanner = Scanner(self.bank, scan_s, moved)
        self.trip = self._scanner.trip

    @property
    def port(self) -> int:
        service = self._server._service
        assert service is not None
        return int(service.server_address[1])

    @property
    def rpm(self) -> int:
        return self.bank.word(RFRD)

    def start(self) -> None:
        self._server.start()
        self._scanner.start()

    def stop(self) -> None:
        self._scanner.stop()
        self._server.stop()
