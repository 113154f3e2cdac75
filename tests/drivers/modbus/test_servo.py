"""The servo driver against a simulated drive, over a real socket and a real pty."""

from __future__ import annotations

import contextlib
import json
import math
import socket
import struct
import subprocess
import sys
import time
from typing import Any

import pytest
from pydantic import ValidationError
from support.descriptors import beyond_select
from support.faults.stalls import standing_still, witnessed
from support.instruments.modbus_bench import ServoBench, cycle, rows_of, status
from support.instruments.name_server import lose_name_server

from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd_drivers.modbus.client import Client
from rigd_drivers.modbus.framing import Trouble
from rigd_drivers.modbus.servo import ENABLED, TRIPPED, ServoConfig

RPM = 2 * math.pi / 60
TCP = pytest.mark.parametrize("line", ["tcp"], indirect=True)
#: Options of each drive; the Delta's watchdog counts whole seconds.
DRIVES = {
    "schneider-atv320": {"map": "schneider-atv320", "watchdog": "1.5 s"},
    "delta-asda-b": {"map": "delta-asda-b", "watchdog": "2 s"},
}
both_drives = pytest.mark.parametrize("drive", list(DRIVES))


def armed(bench: ServoBench, **options: Any) -> Any:
    driver = bench.driver(**options)
    driver.open()
    assert not driver.preflight()
    rows_of(driver, 2)
    driver.arm()
    cycle(driver, lambda rows: driver.ready(), [0.0])
    return driver


@both_drives
def test_drive_is_enabled_at_rest_and_follows_setpoint(servo: ServoBench, drive: str) -> None:
    driver = armed(servo, **DRIVES[drive])
    assert servo.state()["enabled"]
    assert servo.physics.speed == 0.0
    rows = cycle(driver, lambda rows: bool(rows and rows[-1][1] == -1200), [-1200 * RPM])
    assert rows[-1][0] == pytest.approx(-1200 * RPM)
    assert status(rows[-1]) & ENABLED
    assert servo.physics.speed == pytest.approx(-1200 * RPM)
    driver.make_safe()
    assert servo.comes_to_rest()
    assert not servo.state()["enabled"]
    driver.make_safe()  # twice is silent


@pytest.mark.parametrize("drive", ["delta-asda-b"])
def test_setpoints_do_not_wear_out_memory_of_drive(servo: ServoBench) -> None:
    driver = armed(servo, **DRIVES["delta-asda-b"])
    cycle(driver, lambda rows: len(rows) > 3, [10.0])
    assert servo.part._drive.stored == 0


def test_an_axis_moves_in_metres(servo: ServoBench) -> None:
    driver = armed(servo, travel="-0.01 m/rad", max_speed="100 rad/s")
    (setpoint,) = driver.declaration.setpoints
    assert (setpoint.unit, setpoint.low, setpoint.high) == ("m/s", -1.0, 1.0)
    cycle(driver, lambda rows: servo.physics.speed != 0, [0.5])
    assert servo.physics.speed == pytest.approx(-50.0, abs=RPM / 2)


@both_drives
def test_nothing_is_commanded_before_arming(servo: ServoBench, drive: str) -> None:
    driver = servo.driver(**DRIVES[drive])
    driver.open()
    cycle(driver, lambda rows: len(rows) > 4, [100.0])
    state = servo.state()
    assert (state["enabled"], state["setpoint"]) == (False, 0.0)
    assert not driver.ready()


@both_drives
def test_the_watchdog_is_set_and_proven_by_silence(servo: ServoBench, drive: str) -> None:
    driver = servo.driver(**DRIVES[drive])
    driver.open()
    assert servo.state()["watchdog_s"] == pytest.approx(driver.config.watchdog)
    proven_s = driver.prove_watchdog()
    assert driver.watchdog_s is not None
    assert driver.config.watchdog < proven_s < driver.watchdog_s + 1.0
    assert servo.state()["fault_code"] == 0  # it was reset
    rows_of(driver, 1)


def test_dead_watchdog_of_modbus_drive_is_detected(servo: ServoBench) -> None:
    servo.fault("watchdog_dead")
    driver = servo.driver()
    driver.open()
    with pytest.raises(DeviceError, match=r"did not trip; .*1\.5 s"):
        driver.prove_watchdog()


def test_watchdog_that_is_not_kept_refuses_to_arm(servo: ServoBench) -> None:
    servo.fault("watchdog_unset")
    driver = servo.driver()
    driver.open()
    (reason,) = driver.preflight()
    assert "set to 1.5 s and reads back as 10 s" in reason
    assert driver.watchdog_s is None
    with pytest.raises(DeviceError, match="no watchdog to prove"):
        driver.prove_watchdog()


def test_a_silent_master_stops_the_drive(servo: ServoBench) -> None:
    driver = armed(servo)
    cycle(driver, lambda rows: servo.physics.speed != 0, [50.0])
    assert driver.watchdog_s is not None
    with witnessed() as lost_s:
        began = time.monotonic()
        while servo.physics.speed != 0.0:  # the master is silent: that is the test
            assert time.monotonic() - began < driver.watchdog_s + 0.1 + lost_s()
            time.sleep(0.01)
    with pytest.raises(DeviceError, match="communication fault"):
        rows_of(driver, 5)


def test_lost_reply_neither_trips_nor_stops_drive(servo: ServoBench) -> None:
    driver = armed(servo)
    for fault in ("silent", "late", "wrong_unit"):
        servo.fault(fault, count=1)
        cycle(driver, lambda rows: len(rows) > 3, [20.0])
    assert sum(driver.client.counts) >= 3
    assert servo.physics.speed == pytest.approx(20.0, abs=RPM / 2)


def test_lost_replies_while_it_opens_are_repeated(servo: ServoBench) -> None:
    servo.fault("silent", count=3)  # of five tries: the other may fall into a stall of this machine
    armed(servo)
    assert servo.state()["enabled"]


@pytest.mark.parametrize("fault", ["overcurrent", "watchdog_tripped"])
def test_a_fault_of_the_drive_ends_the_run(servo: ServoBench, fault: str) -> None:
    driver = armed(servo)
    servo.fault(fault)
    with pytest.raises(DeviceError, match="the drive reports a fault"):
        cycle(driver, lambda rows: False, [10.0])
    driver.make_safe()


def test_drive_disabled_by_another_master_ends_run(servo: ServoBench) -> None:
    driver = armed(servo)
    other = b"\x06" + (8501).to_bytes(2, "big") + b"\0\0"
    servo.call(lambda: servo.part.bank.answer(other))
    with pytest.raises(DeviceError, match="no longer enabled"):
        cycle(driver, lambda rows: False, [10.0])


@both_drives
def test_watchdog_that_acts_before_arming_is_no_fault(servo: ServoBench, drive: str) -> None:
    driver = servo.driver(**DRIVES[drive])
    driver.open()
    rows_of(driver, 1)
    assert driver.watchdog_s is not None
    with witnessed() as lost_s:
        began = time.monotonic()
        while servo.state()["fault_code"] == 0:  # other devices are being opened meanwhile
            assert time.monotonic() - began < driver.watchdog_s + 0.1 + lost_s()
            time.sleep(0.01)
    assert status(rows_of(driver, 1)[-1]) & TRIPPED
    driver.arm()
    rows = cycle(driver, lambda rows: driver.ready(), [0.0])
    assert status(rows[-1]) & (ENABLED | TRIPPED) == ENABLED
    assert servo.physics.speed == 0.0


def test_fault_before_arming_is_not_watchdog_trip(servo: ServoBench) -> None:
    driver = servo.driver()
    driver.open()
    servo.fault("overcurrent")
    with pytest.raises(DeviceError, match="the drive reports a fault"):
        rows_of(driver, 20)


def test_a_drive_that_has_tripped_already_proves_nothing(servo: ServoBench) -> None:
    driver = servo.driver()
    driver.open()
    servo.fault("watchdog_tripped")
    servo.fault("watchdog_dead")
    with pytest.raises(DeviceError, match="did not trip"):
        driver.prove_watchdog()


def test_fault_of_last_session_is_reset_at_opening(servo: ServoBench) -> None:
    servo.fault("overcurrent")
    armed(servo)


@pytest.mark.parametrize("fault", ["late", "wrong_unit", "silent"])
def test_drive_is_made_safe_in_time_despite_line(servo: ServoBench, fault: str) -> None:
    """One reply is spoiled while a request is out: the disable still comes through.

    Whether its acknowledgement does too, in so short a time, is another matter.
    """
    driver = armed(servo)
    cycle(driver, lambda rows: servo.physics.speed != 0, [50.0])
    servo.fault(fault, count=1)
    asked = servo.state()["asked"]
    cycle(driver, lambda rows: servo.state()["asked"] > asked, [50.0])
    with witnessed() as lost_s:
        began = time.monotonic()
        with contextlib.suppress(LinkError):
            driver.make_safe()
        assert time.monotonic() - began < 0.3 + lost_s()
    assert servo.comes_to_rest()


def test_make_safe_on_dead_line_ends_and_reports(servo: ServoBench) -> None:
    driver = armed(servo)
    servo.fault("deaf")
    with witnessed() as lost_s:
        began = time.monotonic()
        with pytest.raises(LinkError, match=r"watchdog takes its torque away within 1.6 s"):
            driver.make_safe()
        assert time.monotonic() - began < 1.0 + lost_s()
    driver.close()
    driver.make_safe()  # closed: nothing to do, and no error


@TCP
@pytest.mark.parametrize("fault", ["truncated", "garbage", "reset"])
def test_lost_stream_is_opened_again_to_make_safe(servo: ServoBench, fault: str) -> None:
    driver = armed(servo, timeout="0.1 s", watchdog="5 s")
    cycle(driver, lambda rows: servo.physics.speed != 0, [50.0])
    if fault == "reset":
        sock = driver.client._transport._socket
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        sock.shutdown(socket.SHUT_RDWR)
    else:
        servo.fault(fault, count=1)
    with pytest.raises((LinkError, ProtocolError)):
        cycle(driver, lambda rows: len(rows) > 20, [50.0])
        raise LinkError("it rode through")
    driver.make_safe()
    assert servo.comes_to_rest()
    assert servo.state()["fault_code"] == 0  # before its watchdog had to
    driver.make_safe()


def test_slow_drive_is_made_safe_without_complaint(servo: ServoBench) -> None:
    driver = armed(servo, timeout="0.1 s", rate="5 Hz", watchdog="2 s")
    cycle(driver, lambda rows: servo.physics.speed != 0, [50.0])
    servo.fault("late", delay_s=0.08)
    asked = servo.state()["asked"]
    cycle(driver, lambda rows: servo.state()["asked"] > asked, [50.0])
    driver.make_safe()  # a request is out, which it answers first
    assert servo.comes_to_rest()


def test_another_process_can_rescue(servo: ServoBench) -> None:
    driver = armed(servo)
    cycle(driver, lambda rows: servo.physics.speed != 0, [50.0])
    if servo.line.is_serial:
        driver.close()  # as the kernel does for a process that was killed
    with witnessed() as lost_s:
        began = time.monotonic()
        servo.driver().rescue()
        assert time.monotonic() - began < 1.0 + lost_s()
    assert servo.comes_to_rest()


def test_rescue_of_disobedient_drive_fails(servo: ServoBench) -> None:
    driver = armed(servo)
    cycle(driver, lambda rows: servo.physics.speed != 0, [50.0])
    servo.fault("stuck")
    if servo.line.is_serial:
        driver.close()
    with pytest.raises(DeviceError, match="still reports that it is enabled"):
        servo.driver().rescue()


@TCP
def test_drive_that_obeys_during_stall_is_safe(
    servo: ServoBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = armed(servo)
    ask, stall = Client.ask, standing_still(monkeypatch)
    stalls: list[float] = []

    def stalled(client: Client, *args: Any) -> tuple[int, ...]:
        words = ask(client, *args)
        if not stalls:  # once: the drive obeys while this computer stands still
            driver.make_safe()
            while servo.state()["enabled"]:
                pass
            stalls.append(time.monotonic())
            stall()
        return words

    monkeypatch.setattr(Client, "ask", stalled)
    driver.confirm_safe()
    assert stalls


@TCP
def test_drive_is_rescued_beyond_1024_descriptors(servo: ServoBench) -> None:
    driver = armed(servo)
    cycle(driver, lambda rows: servo.physics.speed != 0, [50.0])
    with beyond_select():
        servo.driver().rescue()
    assert servo.comes_to_rest()


@TCP
def test_lost_name_server_does_not_hinder_rescue(
    servo: ServoBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = armed(servo, host="localhost")
    cycle(driver, lambda rows: servo.physics.speed != 0, [50.0])
    lose_name_server(monkeypatch)
    servo.driver(host="localhost").rescue()
    assert servo.comes_to_rest()


@TCP
def test_rescue_without_drive_raises_link_error(servo: ServoBench) -> None:
    with pytest.raises(LinkError, match="cannot connect"):
        servo.driver(port=1).rescue()


def test_a_setpoint_that_is_no_number_is_refused(servo: ServoBench) -> None:
    driver = armed(servo)
    with pytest.raises(DeviceError, match="setpoint 'speed' is NaN"):
        driver.write([math.nan])


@pytest.mark.parametrize("drive", ["delta-asda-b"])
def test_parameter_to_set_at_the_drive_is_named(servo: ServoBench) -> None:
    bank = servo.part.bank
    servo.call(lambda: bank.constant(0x020A, 0x0111))
    with pytest.raises(ProtocolError, match=r"P2-10 .* 0x0111, expected 0x010"):
        servo.driver(map="delta-asda-b", watchdog="1 s").open()


def test_another_drive_is_refused(servo: ServoBench) -> None:
    with pytest.raises((DeviceError, ProtocolError), match="illegal data address"):
        servo.driver(map="delta-asda-b", watchdog="1 s").open()


@TCP
def test_troubles_stand_in_the_status_word(servo: ServoBench) -> None:
    driver = armed(servo)
    servo.fault("wrong_transaction", count=1)
    rows = cycle(driver, lambda rows: bool(rows and status(rows[-1]) >> 8 & 0xFF), [0.0])
    assert status(rows[-1]) >> 8 & 1 << Trouble.WRONG_TRANSACTION


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"watchdog": "0.25 s"}, r"multiple of 0.1 s"),
        ({"watchdog": "0.1 s"}, r"too short for this line"),
        ({"watchdog": "0 s"}, r"greater than 0"),
        ({"max_speed": "40000 rpm"}, r"does not fit into int16"),
        ({"max_speed": "3 m/s"}, r"expected rad/s"),
        ({"rate": "200 Hz"}, r"less than or equal to 100"),
        ({"map": "laumas-tlb4"}, r"no shipped modbus-servo map"),
    ],
)
def test_error_on_wrong_option_names_right_value(options: dict[str, Any], message: str) -> None:
    right = {"host": "h", "map": "schneider-atv320", "max_speed": "100 rpm", "watchdog": "0.5 s"}
    with pytest.raises(ValidationError, match=message):
        ServoConfig.model_validate(right | options)


#: Arms the drive, turns it, and prints that; then continues until it is killed.
_MASTER = """
import json, sys, time
from rigd_drivers.modbus.servo import ModbusServo, ServoConfig
driver = ModbusServo(ServoConfig.model_validate(json.loads(sys.argv[1])), None)
driver.open()
driver.arm()
while True:
    row = driver.read(0)
    driver.write([50.0 if driver.ready() else 0.0])
    if row is not None and abs(row[0]) > 1:
        print("turns", flush=True)
    time.sleep(0.001)
"""


@pytest.mark.parametrize("rescued", [True, False])
def test_master_that_is_killed_leaves_no_drive_turning(servo: ServoBench, rescued: bool) -> None:
    """By another process at once, or by the drive's own watchdog."""
    watchdog = "5 s" if rescued else "0.5 s"
    options = servo.options(map="schneider-atv320", max_speed="3000 rpm", watchdog=watchdog)
    master = subprocess.Popen(
        [sys.executable, "-c", _MASTER, json.dumps(options)], stdout=subprocess.PIPE, text=True
    )
    assert master.stdout is not None
    with master.stdout as said:
        assert said.readline() == "turns\n"
        master.kill()
        master.wait()
    if rescued:
        assert servo.physics.speed == pytest.approx(50.0, abs=RPM / 2)
        servo.driver().rescue()
        assert servo.comes_to_rest()
        assert servo.state()["fault_code"] == 0  # before its watchdog had to
    else:
        end = time.monotonic() + 10
        while servo.physics.speed != 0.0:
            assert time.monotonic() < end
            time.sleep(0.01)
        assert servo.state()["fault_code"] == 5
