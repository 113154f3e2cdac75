"""A drive is made safe, and that it is safe is confirmed: by its PDOs, by SDO, by a rescue."""

from __future__ import annotations

import pytest
from support.can.bench import ENABLED, OFF, Connect, enabled, feedback, wheel
from support.can.script import ScriptedBus, ScriptedServo, number, servo

from rigd.sdk import DeviceError, LinkError
from rigd_drivers.can.cia402_servo.current import CurrentServo


def test_make_safe_sends_zero_and_disable_twice(connect: Connect) -> None:
    driver, port = enabled(connect)
    feedback(port, ENABLED)
    driver.link.begin(0)
    driver.read(0)
    driver.write([1.0])  # queued, and not to be sent after it was made safe
    first = len(port.sent)
    driver.make_safe()
    driver.link.end(0)
    sent = [(to, data.hex(" ")) for to, data in port.sent[first:] if to != 0x77F]
    assert sent == [(0x201, "00 00 00 00"), (0x080, "")] * 2 + [(0x080, "")]
    driver.write([1.0])
    driver.link.end(0)
    assert (port.sent[-2][0], port.sent[-2][1].hex(" ")) == (0x201, "00 00 00 00")


def test_failure_to_make_drive_safe_is_reported(connect: Connect) -> None:
    driver, port = enabled(connect)
    port.full = True
    with pytest.raises(LinkError, match="takes no frames: its queue is full"):
        driver.make_safe()
    driver.link.close()
    driver.make_safe()  # no connection left: the watchdog acts


class Answering(ScriptedServo):
    """A drive that heeds its RPDO at SYNC, and answers each with its statusword."""

    heeds = True

    def hear(self, identifier: int, data: bytes) -> None:
        super().hear(identifier, data)
        if self.silent or self.state != 0x05 or not self.heeds:
            return
        if identifier == 0x080:
            self.outputs.append((0x181, self.objects[0x6041, 0] + bytes(6)))
        elif identifier == 0x201:
            self.written((0x6040, 0), data[:2])


def moving(connect: Connect) -> tuple[Answering, CurrentServo, ScriptedBus]:
    drive = Answering(1, servo().objects)
    bus, port = connect(drive)
    driver = wheel(bus)
    driver.open()
    drive.objects[0x6041, 0] = number(ENABLED, 2)
    return drive, driver, port


def asked_by_sdo(port: ScriptedBus, first: int) -> bool:
    return 0x601 in [to for to, _ in port.sent[first:]]


def test_drive_that_shows_off_is_not_asked(connect: Connect) -> None:
    _, driver, port = moving(connect)
    first = len(port.sent)
    driver.make_safe()
    driver.confirm_safe()
    assert not asked_by_sdo(port, first)


@pytest.mark.parametrize("state", [0x05, 0x04, 0x7F])
def test_drive_that_ignores_its_pdos_is_switched_off(connect: Connect, state: int) -> None:
    drive, driver, _ = moving(connect)
    drive.heeds, drive.state = False, state  # 4: stopped by another master; it answers no SDO
    driver.make_safe()
    assert drive.objects[0x6041, 0] == number(ENABLED, 2)
    driver.confirm_safe()
    assert drive.objects[0x6041, 0] == number(OFF, 2)


class Late(Answering):
    """A drive that still owes an answer to a read of its statusword."""

    owed = bytes.fromhex("4b 41 60 00 37 02 00 00")

    def hear(self, identifier: int, data: bytes) -> None:
        if identifier == 0x601 and data[0] == 0x2B and self.owed:
            self.outputs.append((0x581, self.owed))
            self.owed = b""
        super().hear(identifier, data)


def test_late_answer_does_not_hinder_the_rescue(connect: Connect) -> None:
    drive = Late(1, servo().objects)
    bus, _ = connect(drive)
    drive.objects[0x6041, 0] = number(ENABLED, 2)
    wheel(bus).rescue()
    assert drive.objects[0x6041, 0] == number(OFF, 2)


def test_drive_that_stays_enabled_is_reported(connect: Connect) -> None:
    drive, driver, _ = moving(connect)
    drive.heeds = False
    drive.stuck.add((0x6040, 0))
    drive.written = lambda address, value: None  # type: ignore[method-assign] # takes no order
    driver.make_safe()
    with pytest.raises(DeviceError, match="did not switch off: it is in operation enabled"):
        driver.confirm_safe()


def test_drive_without_answer_is_reported_with_watchdog(connect: Connect) -> None:
    drive, driver, _ = moving(connect)
    drive.silent = True
    driver.make_safe()
    with pytest.raises(LinkError, match=r"does not answer .* its watchdog takes its torque away"):
        driver.confirm_safe()


def test_another_master_does_not_hinder_confirming(connect: Connect) -> None:
    drive = Answering(1, servo().objects)
    bus, port = connect(drive, listen=True)
    driver = wheel(bus)
    driver.open()
    drive.objects[0x6041, 0] = number(ENABLED, 2)
    drive.heeds = False
    for _ in range(3):
        port.say(0x000, "02 01")
    driver.make_safe()
    driver.confirm_safe()
    assert drive.objects[0x6041, 0] == number(OFF, 2)
    port.say(0x000, "02 01")
    with pytest.raises(LinkError, match="another rigd"):
        bus.begin(0)


def test_rescue_verifies_drive_is_off_without_listening(connect: Connect) -> None:
    drive = servo()
    drive.objects[0x6041, 0] = number(ENABLED, 2)
    bus, port = connect(drive)
    bus.close()
    wheel(bus).rescue()
    assert [(to, data.hex(" ")) for to, data in port.sent] == [
        (0x201, "00 00 00 00"),
        (0x080, ""),
        (0x201, "00 00 00 00"),
        (0x080, ""),
        (0x601, "2b 40 60 00 00 00 00 00"),
        (0x601, "40 41 60 00 00 00 00 00"),
    ]
    assert not bus.is_open


def test_failed_rescue_raises_and_closes(connect: Connect) -> None:
    drive = servo()
    drive.objects[0x6041, 0] = number(ENABLED, 2)
    drive.stuck.add((0x6040, 0))
    bus, _ = connect(drive)
    with pytest.raises(DeviceError, match=r"switch off: .*operation enabled"):
        wheel(bus).rescue()
    assert not bus.is_open
    drive.silent = True
    with pytest.raises(LinkError, match="does not answer"):
        wheel(bus).rescue()
    assert not bus.is_open
