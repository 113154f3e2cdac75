"""The action `home` of a CiA 402 drive that is not homed: named, switched off, mode restored."""

from __future__ import annotations

import pytest
from pydantic import ValidationError
from support.can.bench import Clock, Connect, belt, belt_config, cycle
from support.can.script import ScriptedBus, ScriptedServo, number, servo

from rigd.sdk import DeviceError, ProtocolError
from rigd_drivers.can.cia402_servo.speed import SpeedServo

MODE, METHOD, POSITION = (0x6060, 0), (0x6098, 0), (0x6064, 0)
ENABLED, ATTAINED, ERROR = 0x0237, 0x1637, 0x2237


def made() -> ScriptedServo:
    node = servo(2, mode=9)
    node.objects |= {METHOD: number(0, 1), (0x6502, 0): number(1 << 8 | 1 << 5, 4)}
    node.objects[POSITION] = number(1234, 4)
    return node


def opened(connect: Connect, node: ScriptedServo) -> tuple[SpeedServo, ScriptedBus]:
    bus, port = connect(node)
    driver = belt(bus, homing=37, zero="0 count", clutch=False)
    driver.open()
    return driver, port


def shown(driver: SpeedServo, port: ScriptedBus, status: int) -> str:
    """One cycle with this statusword; return the controlword that was sent."""
    port.say(0x182, number(status, 2) + number(0, 2) + number(1234, 4))
    port.say(0x282, number(0, 4))
    (word,) = [data[:5] for to, data in cycle(driver, port, 0.0) if to == 0x202]
    driver.link.wait(lambda: False, 0.002)
    return word


def played(
    driver: SpeedServo,
    port: ScriptedBus,
    *words: int,
    sent: list[str] | None = None,
    clock: Clock | None = None,
    late_s: float = 0.0,
) -> None:
    """Home the drive; show each statusword for 8 cycles, the last one on, and later the clock."""
    driver.act("home")
    for place in range(200):
        word = shown(driver, port, words[min(place // 8, len(words) - 1)])
        if sent is not None:
            sent.append(word)
        assert driver.acted() is None
        if clock is not None and place == 60:
            clock.pass_by(late_s)
            driver.link.beat()


def test_homing_error_of_drive_is_named(connect: Connect) -> None:
    node = made()
    driver, port = opened(connect, node)
    with pytest.raises(DeviceError, match=r"reports a homing error .*0x2237"):
        played(driver, port, 0x0250, 0x0231, 0x0233, ENABLED, ERROR)
    assert node.objects[MODE] == number(9, 1)
    assert shown(driver, port, ENABLED) == "00 00"


def test_position_that_is_not_zero_is_named(connect: Connect, clock: Clock) -> None:
    node = made()
    driver, port = opened(connect, node)
    sent: list[str] = []
    with pytest.raises(DeviceError, match="is not homed after 2 s: its position is 1234"):
        played(driver, port, ATTAINED, sent=sent, clock=clock, late_s=2.5)
    assert "1f 00" in sent and sent[-1] == "00 00"
    assert node.objects[MODE] == number(9, 1)


def test_zero_beyond_end_of_position_range_is_near(connect: Connect) -> None:
    node = made()
    node.objects |= {(0x607B, 1): number(0, 4), (0x607B, 2): number(9999, 4)}
    node.objects[POSITION] = number(9990, 4)
    driver, port = opened(connect, node)
    driver.act("home")
    told = None
    while told is None:
        if shown(driver, port, ATTAINED) == "1f 00":
            node.objects[POSITION] = number(9999, 4)
        told = driver.acted()
    assert told == "node 2 on CAN bus scripted: shows 9999 counts, before 9990"
    port.say(0x182, number(0x0250, 2) + number(0, 2) + number(9999, 4))
    port.say(0x282, number(0, 4))
    driver.link.begin(0)
    row = driver.read(0)
    assert row is not None
    assert row[0] == pytest.approx(-0.1 / 4096)  # one count of 100 mm/rev


def test_drive_that_is_not_enabled_is_not_homed(connect: Connect, clock: Clock) -> None:
    node = made()
    driver, port = opened(connect, node)
    sent: list[str] = []
    with pytest.raises(DeviceError, match="not enabled for homing: switch on disabled"):
        played(driver, port, 0x0250, sent=sent, clock=clock, late_s=3.5)
    assert "06 00" in sent and "1f 00" not in sent
    assert node.objects[MODE] == number(9, 1)


def test_drive_without_homing_mode_is_refused(connect: Connect) -> None:
    node = made()
    node.objects[0x6502, 0] = number(1 << 8, 4)
    driver, port = opened(connect, node)
    with pytest.raises(ProtocolError, match=r"no homing mode \(6\): object 6502 is 0x100"):
        played(driver, port, 0x0250)
    assert METHOD in node.objects and node.objects[METHOD] == number(0, 1)


def test_homing_ends_with_make_safe(connect: Connect) -> None:
    driver, port = opened(connect, made())
    driver.act("home")
    for _ in range(40):
        word = shown(driver, port, ENABLED)
        assert driver.acted() is None
    assert word == "1f 00"
    driver.make_safe()
    assert driver.acted() is None
    assert shown(driver, port, ENABLED) == "00 00"


def test_armed_drive_is_not_homed(connect: Connect) -> None:
    driver, _ = opened(connect, made())
    driver.arm()
    with pytest.raises(DeviceError, match="is armed"):
        driver.act("home")


def test_method_that_moves_is_refused_unopened(connect: Connect) -> None:
    with pytest.raises(ValidationError, match="homing"):
        belt_config(homing=17)
    assert "home" in SpeedServo.declare(belt_config(homing=35)).actions
    assert not SpeedServo.declare(belt_config()).actions
    driver = belt(connect(servo(2, mode=9))[0])
    driver.open()
    with pytest.raises(ValueError, match="no action 'home'"):
        driver.act("home")
