"""The far end of a pseudo-terminal for modbus-tk, which wants a port of pyserial."""

from __future__ import annotations

import os
import select
from dataclasses import dataclass


@dataclass
class PtyPort:
    """As much of pyserial's port as modbus-tk uses, on the far end of a pty."""

    fd: int
    name: str
    baudrate: int = 115200
    is_open: bool = True
    timeout: float | None = None
    inter_byte_timeout: float = 0.0

    @property
    def in_waiting(self) -> int:
        return len(select.select([self.fd], [], [], 0)[0])

    def read(self, size: int) -> bytes:
        wait_s = 0.02 if self.timeout is None else self.timeout
        return os.read(self.fd, size) if select.select([self.fd], [], [], wait_s)[0] else b""

    def write(self, data: bytes) -> None:
        os.write(self.fd, data)

    def flush(self) -> None:
        """Nothing is held back."""

    def cancel_read(self) -> None:
        """A read ends by itself."""

    def close(self) -> None:
        self.is_open = False
