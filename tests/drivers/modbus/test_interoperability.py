"""The simulated devices against pymodbus's clients, which share no code with them.

Its server answers the driver too; of the driver's codec, which is pymodbus's, that proves nothing:
see ``test_foreign_servers.py``.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ModbusIOException
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice
from support.instruments.modbus_bench import PATIENCE_S, ServoBench, TransmitterBench, rows_of

from rigd_drivers.modbus.transmitter import ModbusTransmitter, TransmitterConfig
from rigd_sim.wire.modbus.line import SerialLine, TcpLine


def client_of(bench: TransmitterBench | ServoBench) -> ModbusTcpClient | ModbusSerialClient:
    line = bench.line
    if isinstance(line, TcpLine):
        return ModbusTcpClient("127.0.0.1", port=line.port, timeout=2, retries=0)
    assert isinstance(line, SerialLine)
    line.strict = False  # pymodbus 3.16 sends without the silence that the standard asks for
    return ModbusSerialClient(str(line.path), baudrate=line.baud, parity="N", timeout=2, retries=0)


def shows(client: ModbusTcpClient | ModbusSerialClient, address: int, word: int) -> bool:
    """Wait until the drive has looked at what was written; return whether it shows ``word``."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        if client.read_holding_registers(address, count=1).registers == [word]:
            return True
    return False


def test_pymodbus_reads_the_simulated_transmitter(transmitter: TransmitterBench) -> None:
    client = client_of(transmitter)
    assert client.connect()
    try:
        assert client.read_holding_registers(6, count=5).registers == [0x0800, 0, 1250, 0, 1250]
        assert client.write_registers(5, [7]).isError() is False
        assert client.read_holding_registers(9, count=2).registers == [0, 0]
        assert client.read_holding_registers(0, count=33).exception_code == 3
        assert client.read_holding_registers(999, count=1).exception_code == 2
        assert client.read_coils(0, count=1).exception_code == 1
        with pytest.raises(ModbusIOException):
            client.read_holding_registers(6, count=5, device_id=9)
    finally:
        client.close()  # type: ignore[no-untyped-call]


def test_pymodbus_drives_the_simulated_drive(servo: ServoBench) -> None:
    client = client_of(servo)
    assert client.connect()
    try:
        assert client.read_holding_registers(3201, count=1).registers == [0x0250]
        for command, state in ((6, 0x0231), (7, 0x0233), (15, 0x0237)):
            assert not client.write_register(8501, command).isError()
            assert shows(client, 3201, state)
        assert not client.write_register(8602, 600).isError()
        assert shows(client, 8604, 600)
    finally:
        client.close()  # type: ignore[no-untyped-call]
    assert servo.physics.speed == pytest.approx(62.83, abs=0.01)


@contextmanager
def pymodbus_server(registers: list[int], address: int) -> Iterator[int]:
    """Serve ``registers`` from ``address`` with pymodbus's own server; yield its port."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()

    async def start() -> tuple[ModbusTcpServer, int]:
        data = SimData(address, values=registers, datatype=DataType.REGISTERS)
        server = ModbusTcpServer(SimDevice(1, simdata=[data]), address=("127.0.0.1", 0))
        await server.serve_forever(background=True)
        assert isinstance(server.transport, asyncio.Server)
        return server, server.transport.sockets[0].getsockname()[1]

    try:
        server, port = asyncio.run_coroutine_threadsafe(start(), loop).result(20)
        try:
            yield port
        finally:
            stopping = server.shutdown()  # type: ignore[no-untyped-call]
            asyncio.run_coroutine_threadsafe(stopping, loop).result(20)
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join(20)
        loop.close()


def test_the_driver_reads_a_pymodbus_server() -> None:
    registers = [4, 2024, 1234, 1, 0, 0x0900, 0, 1300, 0, 1250]  # 40002 to 40011, net negative
    with pymodbus_server(registers, 1) as port:
        options = {"map": "laumas-tlb4", "scale": "0.01 N/count", "low": "-50 N", "high": "50 N"}
        config = TransmitterConfig.model_validate({"host": "127.0.0.1", "port": port, **options})
        driver = ModbusTransmitter(config, None)
        driver.open()
        try:
            assert rows_of(driver, 3)[-1] == (-12.5, -1250.0, 1)
            assert sum(driver.client.counts) == 0
        finally:
            driver.close()
