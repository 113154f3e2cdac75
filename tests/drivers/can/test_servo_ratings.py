"""What 1000 per mille of a drive are: units of CiA 402-2, of maxon and of the rig file."""

from __future__ import annotations

import pytest
from support.can.bench import Connect, belt, wheel, wheel_config
from support.can.script import ScriptedBus, ScriptedServo, number, plain_servo, servo

from rigd.sdk import ProtocolError
from rigd_drivers.can.cia402_servo.current import CurrentServo

Objects = dict[tuple[int, int], bytes | None]


def changed(drive: ScriptedServo, objects: Objects) -> ScriptedServo:
    for address, value in objects.items():
        if value is None:
            drive.objects.pop(address, None)
        else:
            drive.objects[address] = value
    return drive


def commanded(driver: CurrentServo, port: ScriptedBus, setpoint: float) -> int:
    """The target that ``setpoint`` becomes once the drive is enabled."""
    driver._armed = driver._enabled = True
    driver.write([setpoint])
    driver.link.end(0)
    data = next(data for to, data in reversed(port.sent) if to == 0x201)
    return int.from_bytes(data[2:4], "little", signed=True)


@pytest.mark.parametrize(
    ("drive", "options"),
    [
        (servo(), {}),  # maxon: 44250 uN m over 29500 uN m/A
        (plain_servo(), {"rated_current": "1.5 A"}),
        (plain_servo(), {"torque_constant": "29.5 mN m/A"}),  # 6075 and 6076 agree
        (plain_servo(), {"rated_torque": "44.25 mN m", "torque_constant": "29.5 mN m/A"}),
        # Per mille of the rated current, which the drive keeps in an object of its maker's own.
        (changed(plain_servo(), {(0x6075, 0): None, (0x6076, 0): None}),
         {"rated_current": "1.5 A", "measured": "current"}),
        # Not maxon, with maxon's unit.
        (changed(plain_servo(), {(0x6076, 0): number(44_250, 4)}),
         {"torque_unit": "1 uN m", "torque_constant": "29.5 mN m/A"}),
        # Objects of another maker at the place of maxon's.
        (changed(plain_servo(), {(0x3001, 1): number(7, 4), (0x3001, 2): number(1, 4),
                                 (0x3001, 5): number(9, 4)}), {"rated_current": "1.5 A"}),
    ],
)  # fmt: skip
def test_current_is_commanded_in_units_of_drive(
    connect: Connect, drive: ScriptedServo, options: dict[str, object]
) -> None:
    bus, port = connect(drive)
    driver = wheel(bus, **options)
    driver.open()
    assert "1000 per mille = 1.5 A" in driver.identity
    assert commanded(driver, port, 0.05) == 33  # 0.05 A of 1.5 A; read as uN m: 33333


@pytest.mark.parametrize("kind", ["6076", "6075"])
def test_unit_that_nothing_confirms_is_refused(connect: Connect, kind: str) -> None:
    options = {"torque_constant": "29.5 mN m/A"} if kind == "6076" else {}
    other = 0x6075 if kind == "6076" else 0x6076
    bus, port = connect(changed(plain_servo(), {(other, 0): None}))
    driver = wheel(bus, **options)
    with pytest.raises(ProtocolError, match=rf"object {kind}.*nothing confirms the unit") as caught:
        driver.open()
    assert "give `rated_current`" in (caught.value.hint or "")
    assert not [data for to, data in port.sent if to == 0x601 and data[1:3] == b"\x40\x60"]


@pytest.mark.parametrize(
    ("objects", "options", "message", "hint"),
    [
        (  # a drive with maxon's unit that is not maxon's
            {(0x6076, 0): number(44_250, 4)},
            {"rated_current": "1.5 A", "torque_constant": "29.5 mN m/A"},
            r"1\.5 A by `rated_current`, 1\.5 A by object 6075, 1500 A by object 6076 "
            r"\(44250 x 0\.001 N m\) over `torque_constant` \(0\.0295 N m/A\)",
            "write `torque_unit: 1e-06 N m`",
        ),
        (
            {(0x6076, 0): number(44_250, 4)},
            {"rated_torque": "44.25 mN m", "torque_constant": "29.5 mN m/A"},
            r"rated torque .*0\.04425 N m by `rated_torque`, 44\.25 N m by object 6076",
            "write `torque_unit: 1e-06 N m`",
        ),
        (  # the motor data of another motor
            {}, {"rated_current": "3 A"},
            r"3 A by `rated_current`, 1\.5 A by object 6075", "correct the option",
        ),
        (
            {}, {"torque_constant": "60 mN m/A"},
            r"1\.5 A by object 6075, 0\.7333 A by object 6076", "correct the option",
        ),
    ],
)  # fmt: skip
def test_contradictory_ratings_are_refused_with_remedy(
    connect: Connect, objects: Objects, options: dict[str, object], message: str, hint: str
) -> None:
    bus, port = connect(changed(plain_servo(), objects))
    with pytest.raises(ProtocolError, match=message) as caught:
        wheel(bus, **options).open()
    assert hint in (caught.value.hint or "")
    assert not [data for to, data in port.sent if to == 0x601 and data[1:3] == b"\x40\x60"]


def test_advised_unit_makes_the_drive_usable(connect: Connect) -> None:
    drive = changed(plain_servo(), {(0x6076, 0): number(44_250, 4)})
    bus, _ = connect(drive)
    given = {"rated_current": "1.5 A", "torque_constant": "29.5 mN m/A"}
    wheel(bus, torque_unit="1e-06 N m", **given).open()


@pytest.mark.parametrize(("entry", "where"), [((0x6072, 0), "6072:00"), ((0x6073, 0), "6073:00")])
def test_limit_of_drive_below_range_is_refused(
    connect: Connect, entry: tuple[int, int], where: str
) -> None:
    bus, _ = connect(changed(plain_servo(), {entry: number(1000, 2)}))
    with pytest.raises(ProtocolError, match=rf"limits its current to 1\.5 A \(object {where}"):
        wheel(bus, rated_current="1.5 A").open()


def test_ratings_of_rig_file_are_compared_unopened() -> None:
    options = {"rated_torque": "44.25 mN m", "torque_constant": "29.5 mN m/A"}
    right = wheel_config(rated_current="1.5 A", **options)
    assert CurrentServo.contradictions(right, None) == []
    (told,) = CurrentServo.contradictions(wheel_config(rated_current="3 A", **options), None)
    assert "is 1.5 A, `rated_current` is 3 A" in told


def test_measured_current_is_read_from_object_6078(connect: Connect) -> None:
    drive = changed(plain_servo(), {(0x6077, 0): None})
    bus, _ = connect(drive)
    wheel(bus, rated_current="1.5 A", measured="current").open()
    assert drive.objects[0x1A00, 2] == bytes.fromhex("10 00 78 60")


def test_force_is_in_unit_of_standard(connect: Connect) -> None:
    bus, port = connect(plain_servo(2, mode=9))
    driver = belt(bus)
    driver.open()
    assert "1000 per mille = 0.044 N m by object 6076" in driver.identity
    port.say(0x182, number(0x0250, 2) + number(1000, 2) + bytes(4))
    port.say(0x282, bytes(4))
    bus.begin(0)
    row = driver.read(0)
    assert row is not None
    assert row[2] == pytest.approx(0.044 * 62.83185, rel=1e-6)  # over 100 mm a turn


def test_axis_without_torque_moves_without_force(connect: Connect) -> None:
    missing: Objects = {(0x6076, 0): None, (0x6077, 0): None, (0x6075, 0): None}
    drive = changed(plain_servo(2, mode=9), missing)
    bus, port = connect(drive)
    driver = belt(bus)
    with pytest.raises(ProtocolError, match=r"rated torque \(object 6076\)") as caught:
        driver.open()
    assert "`force: false`" in (caught.value.hint or "")
    driver = belt(bus, force=False, node=2)
    bus.release(2)
    driver.open()
    assert [channel.name for channel in driver.declaration.channels] == ["position", "speed"]
    port.say(0x182, number(0x0250, 2) + number(4096, 4))
    port.say(0x282, number(60_000, 4))
    bus.begin(0)
    assert driver.read(0) == pytest.approx((0.1, 0.1, 0x1_0250))


def test_drive_without_abort_option_relies_on_proof(connect: Connect) -> None:
    drive = changed(servo(), {(0x6007, 0): None})
    bus, _ = connect(drive)
    wheel(bus).open()
    assert drive.state == 0x05
