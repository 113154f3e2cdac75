"""Setpoints in lines: the device follows, is made safe, and shows it, or the rig is refused."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from support.descriptors import beyond_select
from support.instruments.name_server import lose_name_server
from support.written_drivers import supply_class

from rigd.config.loader import parse_rig
from rigd.model.errors import ConfigError
from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd.sdk.check import Observed, Peer, check_driver
from rigd_drivers.instruments.lines.output_driver import READY, LineOutputs
from rigd_drivers.instruments.lines.outputs import LineOutputsConfig

RIG = r"""rig: bench
title: bench
cycle: 100 Hz
interlocks: []
devices:
  supply:
    driver: line-outputs
    options:
      port: tcp://supply:5025
      identify: '*IDN?\n'
      ask: 'MEAS:VOLT?;:MEAS:CURR?\n'
      separator: ';'
      columns: [voltage, current]
      channels:
        voltage: {unit: V, low: -1 V, high: 33 V}
        current: {unit: A, low: -5 A, high: 5 A}
      outputs:
        voltage: {unit: mV, low: 0 V, high: 30 V, write: 'VOLT {voltage:.1f} MV\n'}
      arm: 'OUTP ON\n'
      safe: ['OUTP OFF\n', 'VOLT 0\n']
      state: {ask: 'OUTP?\n', safe: '0', ready: '1'}
    limits:
      voltage: {low: 0 V, high: 12 V, rate: 5 V/s}
    waiver: {by: A. Person, reason: The emergency stop cuts its mains}
"""
OPTIONS: dict[str, Any] = {
    "ask": r"MEAS:VOLT?;:MEAS:CURR?\n",
    "separator": ";",
    "columns": ["voltage", "current"],
    "channels": {
        "voltage": {"unit": "V", "low": "-1 V", "high": "33 V"},
        "current": {"unit": "A", "low": "-5 A", "high": "5 A"},
    },
    "outputs": {
        "voltage": {"unit": "V", "low": "0 V", "high": "30 V", "write": r"VOLT {voltage:.4f}\n"},
    },
    "arm": r"OUTP ON\n",
    "safe": [r"OUTP OFF\n", r"VOLT 0\n"],
    "state": {"ask": r"OUTP?\n", "safe": "0", "ready": "1"},
    "period": "0.03 s",
}  # fmt: skip
FAULTS = ("dead", "silent", "late", "garbled", "stuck", "locked")


def supply() -> Any:
    """Return a simulated supply with SCPI, which is written apart."""
    return supply_class()()


def observed(device: Any) -> Observed:
    return Observed(driven=(device.driven,), energised=device.output)


@contextmanager
def simulated() -> Iterator[Peer]:
    device = supply()
    try:
        yield Peer(
            options={"port": device.port},
            faults={name: partial(device.fail, name) for name in FAULTS},
            observed=partial(observed, device),
            readings=device.readings,
            vary=device.vary,
        )
    finally:
        device.stop()


def test_it_keeps_what_a_fast_driver_promises() -> None:
    report = check_driver(LineOutputs, OPTIONS, peer=simulated)
    left_out = {
        f"the peer has no fault {fault!r}"
        for fault in ("frozen", "unguarded", "refusing", "another")
    }
    assert set(report.skipped.values()) <= left_out


@contextmanager
def opened(**options: Any) -> Iterator[tuple[LineOutputs, Any]]:
    device = supply()
    port = device.port.replace("127.0.0.1", options.pop("host", "127.0.0.1"))
    config = LineOutputsConfig.model_validate({**OPTIONS, "port": port, **options})
    driver = LineOutputs(config, None)
    try:
        driver.open()
        yield driver, device
    finally:
        driver.close()
        device.stop()


def cycle_until(driver: LineOutputs, voltage: float, wanted: Callable[[], bool]) -> None:
    end = time.monotonic() + 20.0
    while not wanted():
        assert time.monotonic() < end
        driver.read(time.monotonic_ns())
        driver.write((voltage,))
        time.sleep(0.002)


def test_row_shows_that_the_output_is_on() -> None:
    with opened(identify=r"*IDN?\n") as (driver, device):
        assert driver.identity == "ACME,PS30,0042,1.7"
        driver.arm()
        cycle_until(driver, 5.0, lambda: driver.ready() and device.driven == 5.0)
        row = None
        while row is None or row[0] != 5.0:
            row = driver.read(time.monotonic_ns()) or row
        assert row == (5.0, 0.5, READY)
        driver.make_safe()
        driver.confirm_safe()
        assert not device.output


def test_output_that_goes_off_is_reported() -> None:
    with opened() as (driver, device):
        driver.arm()
        cycle_until(driver, 5.0, lambda: driver.ready() and device.driven == 5.0)
        device.output = False
        with pytest.raises(DeviceError, match="switched its output off"):
            cycle_until(driver, 5.0, lambda: False)


def test_output_that_is_on_prevents_arming() -> None:
    with opened(start=r"OUTP ON\n") as (driver, _):
        assert "is on" in driver.preflight()[0]


def test_line_that_is_not_as_described_is_shown() -> None:
    words = r"b'0\.0000;0\.0000': it has 2 columns, expected 3"
    given = {"columns": ["voltage", "current", "-"]}
    with pytest.raises(ProtocolError, match=words), opened(**given):
        pass


def test_device_that_stays_on_is_named() -> None:
    with opened() as (driver, device):
        driver.arm()
        cycle_until(driver, 5.0, lambda: driver.ready() and device.driven == 5.0)
        device.fail("stuck")
        driver.make_safe()
        with pytest.raises(DeviceError, match="is not safe after `safe`: it answers '1'"):
            driver.confirm_safe()
        device.fail("silent")
        with pytest.raises((DeviceError, LinkError)):
            driver.confirm_safe()


class Hesitant:
    """A supply that holds an answer back once, and then ignores that it is switched off."""

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = f"tcp://127.0.0.1:{self._server.getsockname()[1]}"
        self.output, self.holds, self.held = b"0", False, threading.Event()
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        with self._server.accept()[0] as link, link.makefile("rb") as lines, suppress(OSError):
            waiting: list[bytes] = []
            for line in lines:
                answer = {b"MEAS": b"0;0", b"OUTP": self.output}.get(line[:4])
                if line.startswith(b"OUTP ON"):
                    self.output = b"1"
                if b"?" not in line or answer is None:
                    continue
                waiting.append(answer + b"\n")
                if self.holds and line.startswith(b"OUTP?"):
                    self.holds = False
                    self.held.set()
                    continue
                link.sendall(b"".join(waiting))
                waiting.clear()

    def stop(self) -> None:
        self._server.close()


def test_answer_from_before_does_not_confirm_safety() -> None:
    device = Hesitant()
    driver = LineOutputs(LineOutputsConfig.model_validate({**OPTIONS, "port": device.port}), None)
    driver.open()
    device.holds = True
    while not device.held.is_set():
        driver.read(0)
    driver.arm()
    driver.make_safe()
    with pytest.raises(DeviceError, match="is not safe after `safe`"):
        driver.confirm_safe()
    driver.close()
    device.stop()


def drop(device: Any) -> None:
    """Have the device close the connection at the next line; it takes another."""
    answer = device.answer

    def dropping(message: bytes) -> bytes:
        device.answer = answer
        raise ConnectionResetError

    device.answer = dropping


def test_setpoint_does_not_wait_for_late_answer() -> None:
    with opened() as (driver, device):
        driver.arm()
        cycle_until(driver, 5.0, lambda: driver.ready() and device.driven == 5.0)
        answer, heard = device.answer, []

        def losing(message: bytes) -> bytes:
            """Lose the answer to the next question for channels."""
            heard.append(message.decode().split()[0])
            answered: bytes = answer(message)
            lost = message.startswith(b"MEAS") and heard.count(heard[-1]) == 1
            return b"" if lost else answered

        device.answer = losing
        cycle_until(driver, 5.0, lambda: any(item.startswith("MEAS") for item in heard))
        before = len(heard)
        driver.write((7.0,))
        cycle_until(driver, 7.0, lambda: device.driven == 7.0)
        assert heard[before] == "VOLT", "it was sent before the next question"


def test_broken_connection_is_replaced_to_make_safe() -> None:
    with opened() as (driver, device):
        driver.arm()
        cycle_until(driver, 5.0, lambda: driver.ready() and device.driven == 5.0)
        drop(device)
        with pytest.raises(DeviceError, match="is gone"):
            cycle_until(driver, 5.0, lambda: False)
        assert device.output
        driver.make_safe()
        driver.confirm_safe()
        assert not device.output


@contextmanager
def between(device: Any) -> Iterator[tuple[str, Callable[[], None]]]:
    """Pass bytes on; give the port, and what lets connections made before take bytes in vain."""
    _, _, number = device.port.rpartition(":")
    pairs: list[tuple[socket.socket, socket.socket]] = []

    def serve(server: socket.socket) -> None:
        with suppress(OSError):
            while True:
                near, far = server.accept()[0], socket.create_connection(("127.0.0.1", number))
                pairs.append((near, far))
                for ends in ((near, far), (far, near)):
                    threading.Thread(target=carry, args=ends, daemon=True).start()

    def carry(source: socket.socket, to: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(4096):
                to.sendall(data)

    def die() -> None:
        for _, far in pairs:
            far.shutdown(socket.SHUT_RDWR)

    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=serve, args=(server,), daemon=True).start()
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}", die
    for pair in pairs:
        for end in pair:
            end.close()


def test_dead_connection_is_replaced_to_confirm_safe() -> None:
    device = supply()
    with between(device) as (port, die):
        driver = LineOutputs(LineOutputsConfig.model_validate({**OPTIONS, "port": port}), None)
        try:
            driver.open()
            driver.arm()
            cycle_until(driver, 5.0, lambda: driver.ready() and device.driven == 5.0)
            die()
            late_s = time.monotonic() + 2 * driver.config.timeout
            cycle_until(driver, 5.0, lambda: time.monotonic() > late_s)
            driver.make_safe()
            assert device.output
            driver.confirm_safe()
            assert not device.output
        finally:
            driver.close()
            device.stop()


def test_device_is_rescued_beyond_1024_descriptors() -> None:
    with opened() as (driver, device):
        driver.arm()
        cycle_until(driver, 5.0, lambda: driver.ready() and device.driven == 5.0)
        driver.close()  # as the kernel does for a process that was killed
        assert device.output
        with beyond_select():
            LineOutputs(driver.config, None).rescue()
        assert not device.output


def test_lost_name_server_does_not_delay_safety(monkeypatch: pytest.MonkeyPatch) -> None:
    with opened(host="localhost") as (driver, device):
        driver.arm()
        cycle_until(driver, 5.0, lambda: driver.ready() and device.driven == 5.0)
        lose_name_server(monkeypatch)
        drop(device)
        with pytest.raises(DeviceError, match="is gone"):
            cycle_until(driver, 5.0, lambda: False)
        driver.make_safe()
        driver.confirm_safe()
        assert not device.output


def test_lost_name_server_does_not_hinder_rescue(monkeypatch: pytest.MonkeyPatch) -> None:
    with opened(host="localhost") as (driver, device):
        driver.arm()
        cycle_until(driver, 5.0, lambda: driver.ready() and device.driven == 5.0)
        driver.close()  # as the kernel does for a process that was killed
        lose_name_server(monkeypatch)
        LineOutputs(driver.config, None).rescue()
        assert not device.output


def test_device_that_comes_back_is_made_safe() -> None:
    with opened() as (driver, device):
        driver.arm()
        device.stop()
        with pytest.raises(DeviceError, match="is gone"):
            cycle_until(driver, 5.0, lambda: False)
        with pytest.raises(LinkError, match="nothing answers"):
            driver.make_safe()
        with pytest.raises(LinkError, match="is not open"):
            driver.confirm_safe()
        address = driver.config.address
        with socket.create_server((address[0], int(address[1]))) as server:
            driver.make_safe()
            client, _ = server.accept()
            assert client.recv(64) == b"OUTP OFF\nVOLT 0\n"
            client.close()


def test_setpoints_carry_si_units_and_ranges() -> None:
    device = parse_rig(RIG, Path("rig.yaml")).devices["supply"]
    (voltage,) = device.setpoints
    assert (voltage.unit, voltage.low, voltage.high) == ("V", 0.0, 30.0)
    config = device.config
    assert isinstance(config, LineOutputsConfig)
    assert config.outputs["voltage"].line("voltage", 1.25) == b"VOLT 1250.0 MV\n"


@pytest.mark.parametrize(
    ("right", "wrong", "place", "words"),
    [
        ("      safe: ['OUTP OFF\\n', 'VOLT 0\\n']\n", "", "9:7", "'safe' is missing"),
        ("['OUTP OFF\\n', 'VOLT 0\\n']", "[]", "20:13", "at least 1 needed"),
        ("state: {ask: 'OUTP?\\n', safe: '0', ready: '1'}", "", "9:7", "'state' is missing"),
        ("ready: '1'", "ready: '0'", "21:49", "are the same answer"),
        ("mV, low: 0 V, ", "mV, ", "18:18", "'low' is missing"),
        ("{voltage:.1f}", "{current:.1f}", "18:58", "must have {voltage} in braces"),
        ("{voltage:.1f}", "{voltage:.1q}", "18:58", "cannot be filled in"),
        ("ask: 'MEAS:VOLT?;:MEAS:CURR?\\n'", "period: 1 s", "9:7", "'ask' is missing"),
        ("safe: '0', ready: '1'", "safe: '0;0', ready: '1'", "9:7", "could be a line of channels"),
        ("limits:\n      voltage: {low: 0 V, high: 12 V, rate: 5 V/s}", "", "7:5", "no limit"),
    ],
)  # fmt: skip
def test_incomplete_setpoint_is_refused(right: str, wrong: str, place: str, words: str) -> None:
    assert right in RIG
    with pytest.raises(ConfigError) as caught:
        parse_rig(RIG.replace(right, wrong), Path("rig.yaml"))
    found = str(caught.value)
    assert words in found, found
    assert f"rig.yaml:{place}: " in found, found
