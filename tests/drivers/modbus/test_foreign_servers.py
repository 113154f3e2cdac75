"""The driver against servers of other authors.

pyModbusTCP and, where the system has it, libmodbus on TCP; modbus-tk on a serial line.

The driver's codec is pymodbus's, so pymodbus's own server would prove nothing about it.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
from modbus_tk import defines, modbus_rtu
from pyModbusTCP.server import DataBank, ModbusServer
from support.instruments.pty_port import PtyPort
from support.wire import free_ports

from rigd.config.loader import parse_rig
from rigd.sdk import DeviceError
from rigd_drivers.modbus.client import Client
from rigd_drivers.modbus.connection import ConnectionConfig
from rigd_drivers.modbus.pdu import READ_INPUT, read_registers, write_register, write_registers
from rigd_drivers.modbus.transmitter import ModbusTransmitter

# modbus-tk's thread calls a name of threading that has a new one.
pytestmark = pytest.mark.filterwarnings("ignore:isSet:DeprecationWarning")

HOLDING, INPUTS = [555, 0, 100], [10, 0xFFFF]
#: Registers 0 to 99 exist.
REGISTERS = 100


def serve_tcp() -> tuple[ModbusServer, int]:
    """Start pyModbusTCP's server; return it, and its port."""
    bank = DataBank(h_regs_size=REGISTERS, i_regs_size=REGISTERS)
    bank.set_holding_registers(7, HOLDING)
    bank.set_input_registers(3, INPUTS)
    server = ModbusServer("127.0.0.1", 0, no_block=True, data_bank=bank)
    server.start()
    assert server._service is not None
    return server, server._service.server_address[1]


@pytest.fixture
def tcp() -> Iterator[Client]:
    """A client of pyModbusTCP's server."""
    server, port = serve_tcp()
    config = ConnectionConfig.model_validate({"host": "127.0.0.1", "port": port, "timeout": "1 s"})
    client = config.client(0.0)
    client.open()
    yield client
    client.close()
    server.stop()


@pytest.fixture
def rtu() -> Iterator[Client]:
    """A client of modbus-tk's server."""
    master, slave = os.openpty()
    tty.setraw(slave)
    server = modbus_rtu.RtuServer(PtyPort(master, os.ttyname(slave)))
    unit = server.add_slave(1)
    unit.add_block("holding", defines.HOLDING_REGISTERS, 0, REGISTERS)
    unit.add_block("input", defines.READ_INPUT_REGISTERS, 0, REGISTERS)
    unit.set_values("holding", 7, HOLDING)
    unit.set_values("input", 3, INPUTS)
    server.start()
    line = {"serial_port": os.ttyname(slave), "baud": 115200, "parity": "none"}
    config = ConnectionConfig.model_validate(line | {"timeout": "1 s", "longest_reply": "1 s"})
    client = config.client(0.0)
    client.open()
    yield client
    client.close()
    server.stop()
    os.close(master)
    os.close(slave)


#: Debian has it as libmodbus5; a system without it has no tests of it.
LIBMODBUS = ctypes.util.find_library("modbus")


class Mapping(ctypes.Structure):
    """``modbus_mapping_t`` of libmodbus 3.1."""

    _fields_ = (
        *((f"count_{number}", ctypes.c_int) for number in range(8)),
        ("bits", ctypes.c_void_p),
        ("input_bits", ctypes.c_void_p),
        ("inputs", ctypes.POINTER(ctypes.c_uint16)),
        ("holding", ctypes.POINTER(ctypes.c_uint16)),
    )


@pytest.fixture
def libmodbus() -> Iterator[Client]:
    """A client of a server on libmodbus, which is no package of Python."""
    library = ctypes.CDLL(LIBMODBUS)
    library.modbus_new_tcp.restype = ctypes.c_void_p
    library.modbus_mapping_new.restype = ctypes.POINTER(Mapping)
    (port,) = free_ports(1)
    context = ctypes.c_void_p(library.modbus_new_tcp(b"127.0.0.1", port))
    mapping = library.modbus_mapping_new(0, 0, REGISTERS, REGISTERS)
    for values, first, words in (("holding", 7, HOLDING), ("inputs", 3, INPUTS)):
        for number, word in enumerate(words, start=first):
            getattr(mapping.contents, values)[number] = word
    listening = ctypes.c_int(library.modbus_tcp_listen(context, 1))
    assert listening.value >= 0

    def serve() -> None:
        library.modbus_tcp_accept(context, ctypes.byref(listening))
        request = ctypes.create_string_buffer(260)
        while (size := library.modbus_receive(context, request)) >= 0:
            library.modbus_reply(context, request, size, mapping)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    config = ConnectionConfig.model_validate({"host": "127.0.0.1", "port": port, "timeout": "1 s"})
    client = config.client(0.0)
    client.open()
    yield client
    client.close()
    thread.join()
    os.close(listening.value)
    library.modbus_close(context)
    library.modbus_mapping_free(mapping)
    library.modbus_free(context)


@pytest.fixture(params=["tcp", *(["libmodbus"] if LIBMODBUS else []), "rtu"])
def client(request: pytest.FixtureRequest) -> Client:
    """One of them, opened."""
    found = request.getfixturevalue(request.param)
    assert isinstance(found, Client)
    return found


def test_registers_are_read_with_both_functions(client: Client) -> None:
    assert client.ask(read_registers(7, 3)) == tuple(HOLDING)
    assert client.ask(read_registers(3, 2, READ_INPUT)) == tuple(INPUTS)
    assert sum(client.counts) == 0


def test_written_registers_read_back_unchanged(client: Client) -> None:
    assert client.ask(write_register(20, 0xABCD)) == ()
    assert client.ask(write_registers(21, [1, 0xFFFF, 3])) == ()
    assert client.ask(read_registers(20, 4)) == (0xABCD, 1, 0xFFFF, 3)
    assert sum(client.counts) == 0


def test_the_largest_read_and_write_pass(client: Client) -> None:
    words = list(range(1000, 1000 + REGISTERS))
    assert client.ask(write_registers(0, words)) == ()
    assert client.ask(read_registers(0, REGISTERS)) == tuple(words)


def test_a_refusal_is_named(client: Client) -> None:
    with pytest.raises(DeviceError, match="exception 2, illegal data address"):
        client.ask(read_registers(REGISTERS, 1))
    assert client.ask(read_registers(7, 1)) == (HOLDING[0],)


RIG = """
rig: cell-1
title: A cell with a map of its own
cycle: 100 Hz
devices:
  cell:
    driver: modbus-transmitter
    options:
      host: 127.0.0.1
      port: {port}
      low: -10 N
      high: 2000 N
      timeout: 1 s
      map:
        title: a cell
        source: its manual
        read_function: 4
        write_function: 16
        scale: 1 N/count
        force: {{address: 0x0003, type: uint16}}
        actions:
          tare: {{doc: takes the tare, writes: [{{address: 0x14, value: 0x00AB}}]}}
  line:
    driver: modbus-transmitter
    options:
      {{serial_port: /dev/none, parity: none, stop_bits: 2, map: seneca-z-sg2, scale: 1 N/count,
       low: -10 N, high: 10 N}}
interlocks: []
"""


def test_rig_file_chooses_functions_and_stop_bits() -> None:
    server, port = serve_tcp()
    devices = parse_rig(RIG.format(port=port), Path("rig.yaml")).devices
    assert getattr(devices["line"].config, "stop_bits") == 2  # noqa: B009 - of its driver
    cell = devices["cell"].driver_class(devices["cell"].config, None)
    assert isinstance(cell, ModbusTransmitter)
    cell.open()
    cell.act("tare")
    row = done = None
    while row is None or done is None:
        row = cell.read(0) or row
        done = cell.acted() or done
    cell.close()
    assert row.force == INPUTS[0]
    assert server.data_bank.get_holding_registers(20) == [0xAB]
    server.stop()
