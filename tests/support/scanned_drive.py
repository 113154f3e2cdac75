"""A drive on pyModbusTCP's server that looks at its command word once per scan, as real ones do.

It has the registers of an Altivar 320 (NVE41308, NVE41316) and is written without rigd's own
simulated drive.
"""

from __future__ import annotations

import threading
import time
from typing import Any

from pyModbusTCP.server import DataBank, ModbusServer

CMD, ETA, LFRD, RFRD, SLL, TTO, LFT = 8501, 3201, 8602, 8604, 7010, 6005, 7121
_READY, _SWITCHED_ON, _ENABLED, _DISABLED, _FAULT = 0x0231, 0x0233, 0x0237, 0x0250, 0x0218
_SLF1 = 5


class _Heard(DataBank):  # type: ignore[misc]  # the package has no types
    def __init__(self) -> None:
        super().__init__(h_regs_size=10_000)
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


class ScannedDrive:
    """The drive, served from :meth:`start` until :meth:`stop`; its motor turns as commanded."""

    def __init__(self, scan_s: float) -> None:
        self.bank = _Heard()
        self._scan_s = scan_s
        self._server = ModbusServer("127.0.0.1", 0, no_block=True, data_bank=self.bank)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._seen = 0
        self._show(ETA, _DISABLED)
        self._show(TTO, 100)

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
        self._thread.start()

    def stop(self) -> None:
        self._ended.set()
        self._thread.join()
        self._server.stop()

    def trip(self) -> None:
        self._show(LFT, _SLF1)
        self._show(ETA, _FAULT)

    def _run(self) -> None:
        while not self._ended.wait(self._scan_s):
            self._scan()

    def _scan(self) -> None:
        command, state = self.bank.word(CMD), self.bank.word(ETA)
        risen, self._seen = command & ~self._seen, command
        silent_s = time.monotonic() - self.bank.at
        if state == _FAULT:
            state = _DISABLED if risen & 0x80 else _FAULT
        elif self.bank.at and self.bank.word(SLL) and silent_s > 0.1 * self.bank.word(TTO):
            self._show(LFT, _SLF1)
            state = _FAULT
        elif command & 0xF == 0x6:
            state = _READY
        elif command & 0xF == 0x7 and state in (_READY, _ENABLED):
            state = _SWITCHED_ON
        elif command & 0xF == 0xF and state == _SWITCHED_ON:
            state = _ENABLED
        elif not command & 0x2:
            state = _DISABLED
        self._show(ETA, state)
        self._show(RFRD, self.bank.word(LFRD) if state == _ENABLED else 0)

    def _show(self, address: int, word: int) -> None:
        self.bank.set_holding_registers(address, [word])
