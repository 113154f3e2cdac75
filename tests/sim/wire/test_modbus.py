"""The simulated Modbus devices by themselves: frames, registers, the pace of a serial line."""

from __future__ import annotations

import asyncio
import contextlib
import os
import statistics
import termios
import time
import tty
from pathlib import Path
from typing import Any

import pytest

from rigd_sim.wire.modbus import SerialLine, SimModbusServo, SimModbusTransmitter, TcpLine
from rigd_sim.wire.modbus.bank import Bank
from rigd_sim.wire.modbus.drive_options import ModbusDriveOptions
from rigd_sim.wire.modbus.frames import Ask, NotModbus, build_rtu, build_tcp, take_rtu, take_tcp
from rigd_sim.wire.modbus.servo import Altivar, Asda
from rigd_sim.wire.modbus.transmitter import LoadCell

#: How often a machine that stalls may spoil what must be quick.
TRIES = 100


def test_serial_frames_of_the_delta_manual() -> None:
    # Delta ASDA-B user manual (January 2009), section 8.3, RTU mode.
    read = bytearray.fromhex("01 03 02 00 00 02 C5 B3")
    assert take_rtu(read) == Ask(1, bytes.fromhex("03 02 00 00 02"))
    assert not read
    assert build_rtu(1, bytes.fromhex("03 04 00 B1 1F 40")) == bytes.fromhex(
        "01 03 04 00 B1 1F 40 A3 D4"
    )
    # ASDA-A2 user manual (January 2011), page 9-12: write of two words.
    write = bytearray.fromhex("01 10 01 12 00 02 04 0B B8 00 00 FC EB")
    ask = take_rtu(write)
    assert ask is not None
    assert ask.pdu[0] == 16


@pytest.mark.parametrize("size", range(8))
def test_incomplete_request_is_not_taken(size: int) -> None:
    assert take_rtu(bytearray.fromhex("01 03 02 00 00 02 C5 B3")[:size]) is None


def test_request_with_wrong_crc_is_not_taken() -> None:
    assert take_rtu(bytearray.fromhex("01 03 02 00 00 03 C5 B3")) is None


def test_tcp_frames_of_the_guide() -> None:
    # Messaging on TCP/IP Implementation Guide V1.0b, section 4.4.2.1.
    request = bytearray.fromhex("15 01 00 00 00 06 FF 03 00 04 00 01")
    assert take_tcp(bytearray(request[:-1])) is None
    assert take_tcp(request) == Ask(0xFF, bytes.fromhex("03 00 04 00 01"), 0x1501)
    assert build_tcp(0xFF, bytes.fromhex("03 02 00 05"), 0x1501) == bytes.fromhex(
        "15 01 00 00 00 05 FF 03 02 00 05"
    )
    with pytest.raises(NotModbus):
        take_tcp(bytearray(b"GET / HTTP/1.1"))


def test_bank_answers_as_in_the_standard() -> None:
    bank = Bank(max_registers=4)
    bank.number(0x6B, "uint16", lambda: 555)
    bank.number(0x6C, "int32", lambda: -2)
    taken: list[int] = []
    bank.writable(0x10, taken.append)
    assert bank.answer(bytes.fromhex("03 00 6B 00 03")).hex() == "0306022bfffffffe"
    assert bank.answer(bytes.fromhex("03 00 6B 00 04")).hex() == "8302"  # 0x6E does not exist
    assert bank.answer(bytes.fromhex("03 00 6B 00 05")).hex() == "8303"  # more than it can
    assert bank.answer(bytes.fromhex("2B 0E 01 00 00")).hex() == "ab01"
    assert bank.answer(bytes.fromhex("03 00")).hex() == "8303"
    assert bank.answer(bytes.fromhex("06 00 10 00 07")).hex() == "0600100007"
    assert bank.answer(bytes.fromhex("10 00 10 00 01 02 00 08")).hex() == "1000100001"
    assert bank.answer(bytes.fromhex("10 00 10 00 01 04 00 08")).hex() == "9003"
    assert bank.answer(bytes.fromhex("06 00 11 00 07")).hex() == "8602"
    assert taken == [7, 8]
    bank.swapped = True
    assert bank.answer(bytes.fromhex("03 00 6C 00 02")).hex() == "0304fffeffff"


def test_both_words_of_number_are_of_one_reading() -> None:
    readings = iter([0x0001_FFFF, 0x0002_0000])
    bank = Bank()
    bank.number(0, "uint32", lambda: next(readings))
    assert bank.answer(bytes.fromhex("03 00 00 00 02")).hex() == "03040001ffff"


def test_the_load_cell_filters_and_settles() -> None:
    now, force = 0.0, 0.0
    cell = LoadCell(lambda: force, capacity=100, resolution=0.01, filter_s=0.1, now=lambda: now)
    assert cell.stable
    force = 10.0
    now = 0.1
    assert cell.gross() == pytest.approx(10 * (1 - 2.718281828**-1), rel=0.05)
    assert not cell.stable
    now = 1.5
    assert cell.gross() == pytest.approx(10.0, abs=0.01)
    assert cell.stable
    cell.tare()
    assert (cell.net(), round(cell.gross(), 1)) == (0.0, 10.0)
    cell.untare()
    cell.zero()
    assert cell.gross() == 0.0


def test_load_cell_noise_is_as_large_as_stated() -> None:
    now = 0.0
    cell = LoadCell(lambda: 5.0, capacity=100, resolution=0.01, noise=0.2, seed=3, now=lambda: now)
    readings = []
    for _ in range(2000):
        now += 1 / 300
        readings.append(cell.gross())
    assert statistics.mean(readings) == pytest.approx(5.0, abs=0.02)
    assert statistics.stdev(readings) == pytest.approx(0.2, rel=0.1)


def test_drivecom_chart_allows_one_step_up_at_time() -> None:
    turned: list[tuple[float, bool]] = []
    drive = Altivar(lambda *wanted: turned.append(wanted), lambda: 0.0)
    bank = drive.bank()

    def command(word: int) -> str:
        bank.answer(b"\x06" + (8501).to_bytes(2, "big") + word.to_bytes(2, "big"))
        drive.tick()
        return bank.answer(bytes.fromhex("03 0C 81 00 01"))[2:].hex()

    bank.answer(bytes.fromhex("06 21 9A 02 58"))  # 8602: 600 rev/min
    assert command(15) == "0250"  # from switch-on-disabled: no
    assert [command(6), command(7), command(15)] == ["0231", "0233", "0237"]
    ((speed, enabled),) = turned
    assert enabled
    assert speed == pytest.approx(62.83, abs=0.01)
    drive.trip(9)
    assert turned[-1] == (0.0, False)
    assert command(15) == "0218"  # a fault stays until its reset
    assert [command(0x80), command(6)] == ["0250", "0231"]


def test_pulse_shorter_than_scan_is_never_seen() -> None:
    drive = Altivar(lambda speed, enabled: None, lambda: 0.0)
    bank = drive.bank()
    drive.trip(9)
    for word in (0, 0x80, 0):
        bank.answer(b"\x06" + (8501).to_bytes(2, "big") + word.to_bytes(2, "big"))
    drive.tick()
    assert drive.fault_code == 9


@pytest.mark.parametrize("kind", [Altivar, Asda])
def test_watchdog_trips_after_its_time_and_not_before(kind: Any) -> None:
    now = 0.0
    drive = kind(lambda speed, enabled: None, lambda: 0.0, lambda: now)
    drive.watchdog_s = 1.0
    now = 50.0
    drive.tick()
    assert drive.fault_code == 0  # it watches from the first request on
    drive.heard()
    now = 50.9
    drive.tick()
    assert drive.fault_code == 0
    now = 51.1
    drive.tick()
    assert drive.fault_code == kind.silence_code


def cell() -> LoadCell:
    return LoadCell(lambda: 1.0, capacity=10, resolution=0.01)


async def ask_raw(fd: int, request: bytes, size: int) -> list[tuple[float, bytes]]:
    """Send ``request``; return what comes and when (s since), until ``size`` bytes have."""
    loop = asyncio.get_running_loop()
    came: list[tuple[float, bytes]] = []
    done = asyncio.Event()
    began = time.monotonic()

    def take() -> None:
        came.append((time.monotonic() - began, os.read(fd, 4096)))
        if sum(len(data) for _, data in came) >= size:
            done.set()

    loop.add_reader(fd, take)
    try:
        os.write(fd, request)
        await asyncio.wait_for(done.wait(), 10)
    finally:
        loop.remove_reader(fd)
    return came


async def heard_out(fd: int, size: int) -> None:
    """Read the ``size`` bytes of a reply that is under way."""
    while size > 0:
        await asyncio.sleep(0.001)
        with contextlib.suppress(BlockingIOError):
            size -= len(os.read(fd, size))


def open_line(path: Path, baud: int) -> int:
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    tty.setraw(fd)
    attributes = termios.tcgetattr(fd)
    attributes[4] = attributes[5] = baud
    termios.tcsetattr(fd, termios.TCSANOW, attributes)
    return fd


def test_reply_bytes_leave_at_serial_line_speed(tmp_path: Path) -> None:
    """27 bytes at 2400 baud take 124 ms, and the request and two gaps before them 69 ms.

    They come in many pieces, as over a wire, unless the machine held this process up: then they are
    asked for again. A device that hands over whole replies never sends pieces.
    """

    async def run() -> int:
        line = SerialLine(tmp_path / "tty", 2400)
        part = SimModbusTransmitter("cell", line, cell())
        where = await part.start()
        assert str(tmp_path / "tty") in where
        fd = open_line(line.path, termios.B2400)
        try:
            request = build_rtu(1, bytes.fromhex("03 00 00 00 0B"))
            came = await ask_raw(fd, request, 27)
        finally:
            os.close(fd)
            await part.stop()
        character_s = 11 / 2400
        first = len(request) * character_s + 3.5 * character_s
        seen = 0
        for at, data in came:
            seen += len(data)
            assert at >= first + seen * character_s - 1e-3
        assert not line.path.is_symlink()
        return len(came)

    assert any(asyncio.run(run()) > 5 for _ in range(10))


def test_request_at_wrong_baud_or_timing_is_ignored(tmp_path: Path) -> None:
    async def run() -> None:
        line = SerialLine(tmp_path / "tty", 19200)
        part = SimModbusTransmitter("cell", line, cell())
        await part.start()
        request = build_rtu(1, bytes.fromhex("03 00 06 00 05"))
        fd = open_line(line.path, termios.B9600)
        try:
            os.write(fd, request)
            while line.ignored == 0:
                await asyncio.sleep(0.001)
            assert part.asked == 0
        finally:
            os.close(fd)
        fd = open_line(line.path, termios.B19200)
        try:
            for _ in range(TRIES):
                await asyncio.sleep(0.01)
                await ask_raw(fd, request, 15)
                asked = part.asked
                os.write(fd, request)  # at once: no silence before it, unless this machine stalls
                while line.ignored == 1 and part.asked == asked:
                    await asyncio.sleep(0.001)
                if line.ignored > 1:
                    break
                await heard_out(fd, 15)
            assert (line.ignored, part.asked) == (2, asked)
        finally:
            os.close(fd)
            await part.stop()

    asyncio.run(run())


def test_name_left_by_killed_process_is_taken_over(tmp_path: Path) -> None:
    async def run() -> None:
        path = tmp_path / "tty"
        path.symlink_to("/dev/pts/nowhere")
        part = SimModbusTransmitter("cell", SerialLine(path), cell())
        await part.start()
        fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
        assert os.ttyname(fd) == str(path.resolve())
        os.close(fd)
        await part.stop()
        await part.stop()  # twice is silent
        path.write_text("somebody's file")
        with pytest.raises(OSError, match="exists"):
            await part.start()
        assert path.read_text() == "somebody's file"

    asyncio.run(run())


def test_a_port_that_is_taken_is_an_error() -> None:
    async def run() -> None:
        first = SimModbusTransmitter("one", TcpLine(port=0), cell())
        await first.start()
        assert isinstance(first.line, TcpLine)
        second = SimModbusTransmitter("two", TcpLine(port=first.line.port), cell())
        with pytest.raises(OSError, match="in use"):
            await second.start()
        await first.stop()

    asyncio.run(run())


def test_unknown_fault_is_refused_with_known_ones_named() -> None:
    part = SimModbusTransmitter("cell", TcpLine(), cell())
    with pytest.raises(ValueError, match=r"'fire'.* silent, .*frozen"):
        part.inject("fire")
    with pytest.raises(ValueError, match="no fault 'crc' here"):
        part.inject("crc")  # a serial line's only
    with pytest.raises(ValueError, match="no option 'loud'; it knows"):
        part.inject("late", loud=True)
    with pytest.raises(ValueError, match="no instrument 'x'; known: laumas-tlb4"):
        SimModbusTransmitter("cell", TcpLine(), cell(), instrument="x")


def test_every_fault_of_drive_shows_in_its_state() -> None:
    part = SimModbusServo(
        "drive", TcpLine(), command=lambda speed, enabled: None, speed=lambda: 0.0
    )
    assert part.state()["fault_code"] == 0
    part.inject("overcurrent")
    assert part.state()["fault_code"] == 9
    part.inject("watchdog_tripped")
    assert part.state()["fault_code"] == 5


def test_host_without_port_is_refused() -> None:
    assert ModbusDriveOptions(host="127.0.0.1", port=15020).port == 15020
    with pytest.raises(ValueError, match="'host' needs a 'port'"):
        ModbusDriveOptions(host="127.0.0.1")
