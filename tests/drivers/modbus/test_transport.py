"""The serial port of Modbus RTU, which may be missing or held."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from rigd.sdk import LinkError
from rigd_drivers.modbus.transport import SerialTransport


def transport(port: str) -> SerialTransport:
    return SerialTransport(port, 19200, "N", 1)


def test_missing_serial_port_is_named(tmp_path: Path) -> None:
    port = str(tmp_path / "ttyUSB8")
    with pytest.raises(LinkError) as caught:
        transport(port).open(1.0)
    assert caught.value.message == f"there is no serial port {port}"


def test_serial_port_of_another_program_is_named() -> None:
    master, slave = os.openpty()
    holder, second = transport(os.ttyname(slave)), transport(os.ttyname(slave))
    holder.open(1.0)
    with pytest.raises(LinkError, match="another program holds"):
        second.open(1.0)
    holder.close()
    os.close(master)
    os.close(slave)
