"""Profiles of drives and encoders: what they check, write and choose, against scripted nodes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from support.can.bench import (
    ENABLED,
    OFF,
    Connect,
    belt,
    belt_config,
    cycle,
    encoder,
    feedback,
    wheel,
    wheel_config,
)
from support.can.script import encoder as scripted_encoder
from support.can.script import number, pdo, servo

from rigd.sdk import ProtocolError
from rigd_drivers import device_file
from rigd_drivers.can.cia402_servo.profile import DriveProfile

PROFILES = device_file.shipped("cia402")
ABOUT = {"title": "Test drive", "source": "test"}
MAKE = {**ABOUT, "vendor": 0xFB, "torque": {}, "speed": {"velocity_unit": "0.001 rpm"}}


def shipped(name: str) -> DriveProfile:
    """Return the shipped profile of that name."""
    path = device_file.find(name, "cia402", Path("nowhere"))
    return device_file.read(path, DriveProfile, path)


@pytest.mark.parametrize("path", PROFILES, ids=lambda path: path.stem)
def test_shipped_profile_names_source_and_standing(path: Path) -> None:
    profile = shipped(path.stem)
    assert len(profile.source) > 40
    assert profile.standing == "from the manual, not seen on the device"


@pytest.mark.parametrize(
    ("name", "vendor", "current", "torque_unit"),
    [
        # DCF of an EPOS4 50/15: 6076 is 512871, 3001:01 is 4760 mA, 3001:05 107746 uN m/A.
        ("maxon-epos4", 0xFB, (0x3001, 1, 1e-3), 512871e-6 / 512871),
        # Elmo, MAN-CAN402IG page 106: "in multiples of milliamp", "a multiple of mNm".
        ("elmo-gold", 0x9A, (0x6075, 0, 1e-3), 1e-3),
        # Nanotec: "the rated current entered in 203Bh:01 in mA".
        ("nanotec", None, (0x203B, 1, 1e-3), None),
        ("kollmorgen-akd", 0x6A, None, None),
    ],
)
def test_shipped_profile_matches_its_source(
    name: str, vendor: int | None, current: Any, torque_unit: float | None
) -> None:
    profile = shipped(name)
    assert profile.vendor == vendor
    assert profile.torque_unit == (None if torque_unit is None else pytest.approx(torque_unit))
    if current is None:
        assert profile.rated_current is None
        return
    assert profile.rated_current is not None
    entry = profile.rated_current.entry("rated current")
    assert (entry.index, entry.sub, profile.rated_current.unit) == pytest.approx(current)


def test_device_of_other_vendor_is_refused(connect: Connect) -> None:
    bus, port = connect(servo())
    with pytest.raises(ProtocolError, match=r"vendor id 0xFB .* Elmo Gold expects 0x9A") as caught:
        wheel(bus, profile="elmo-gold").open()
    assert "`profile`" in (caught.value.hint or "")
    written = [data[:4].hex() for to, data in port.sent if to == 0x601 and data[0] >> 5 == 1]
    assert written == ["2b171000"]  # the heartbeat alone


@pytest.mark.parametrize(
    ("added", "said"),
    [
        ({"products": [0x402]}, "product code 0x7 .* expects 0x402"),
        (
            {"expect": [{"object": "6096:01", "type": "uint32", "value": 1, "name": "factor"}]},
            r"6096:01 \(factor\) is 3, the profile of the Test drive expects 1",
        ),
        (
            {"setup": [{"object": "60C2:01", "type": "uint8", "value": 2, "name": "period"}]},
            r"60C2:01 \(period\) reads back 9 .* written was 2",
        ),
        ({"torque": {"mode": "profile"}}, r"profile torque mode \(4\): object 6502 is 0x200"),
    ],
)
def test_contradiction_of_profile_and_device_is_refused(
    connect: Connect, added: dict[str, Any], said: str
) -> None:
    drive = servo()
    drive.objects |= {
        (0x1018, 2): number(7, 4),
        (0x6096, 1): number(3, 4),
        (0x60C2, 1): number(9, 1),
    }
    drive.stuck.add((0x60C2, 1))
    bus, _ = connect(drive)
    with pytest.raises(ProtocolError, match=said):
        wheel(bus, profile={**MAKE, **added}).open()


def test_startup_values_are_written_in_order(connect: Connect) -> None:
    drive = servo()
    drive.objects |= {(0x2100, 1): number(0, 1), (0x6087, 0): number(0, 4)}
    drive.stuck.add((0x2100, 1))  # a command: it reads back as 0
    bus, port = connect(drive)
    setup = [
        {"object": "6087:00", "type": "uint32", "value": 100000, "name": "torque slope"},
        {"object": "2100:01", "type": "uint8", "value": 5, "name": "take over", "keeps": False},
    ]
    driver = wheel(bus, profile={**MAKE, "setup": setup})
    driver.open()
    written = [data.hex() for to, data in port.sent if to == 0x601 and data[0] >> 5 == 1]
    slope = written.index("23876000a0860100")
    assert written[slope + 1] == "2f00210105000000"
    assert written.index("2f6060000a000000") > slope + 1  # the mode, and enabling, come later
    assert driver.identity.endswith(
        "profile Test drive (from the manual, not seen on the device) in cyclic torque mode (10)"
    )


def test_profile_chooses_pdos_objects_and_identifiers(connect: Connect) -> None:
    drive = servo()
    drive.objects |= pdo(0x1402, 0x1602, 0x401) | {(0x2030, 0): number(0, 4)}
    bus, port = connect(drive)
    pdos = {
        "command": {"number": 3, "cob_id": 0x400},
        "feedback": [{"number": 2, "cob_id": 0x280}, {"number": 3, "cob_id": 0x380}],
    }
    actual = {"object": "2030:00", "type": "int16"}
    driver = wheel(bus, profile={**MAKE, "pdos": pdos, "torque": {"actual": actual}})
    driver.open()
    kept = drive.objects
    assert kept[0x1402, 1] == number(0x401, 4)
    assert [kept[0x1602, sub].hex() for sub in (1, 2)] == ["10004060", "10007160"]
    assert kept[0x1801, 1] == number(0x4000_0281, 4)
    assert [kept[0x1A01, sub].hex() for sub in (1, 2, 3)] == ["10004160", "10003020", "20006460"]
    unused = [(0x1400, 1), (0x1401, 1), (0x1800, 1), (0x1802, 1), (0x1803, 1)]
    assert all(kept[address][3] & 0x80 for address in unused)
    driver.arm()
    port.say(0x281, number(OFF, 2) + number(0, 2) + number(0, 4))
    assert (0x401, "06 00 00 00") in cycle(driver, port, 0.0)


def test_profile_modes_need_no_bit_12(connect: Connect) -> None:
    bus, port = connect(servo(mode=4))
    driver = wheel(bus, profile={**MAKE, "torque": {"mode": "profile"}})
    driver.open()
    driver.arm()
    for status in (OFF, 0x0231, 0x0233, ENABLED & ~0x1000):
        feedback(port, status)
        cycle(driver, port, 0.0)
    assert driver.ready()
    feedback(port, ENABLED & ~0x1000)
    assert cycle(driver, port, 0.75)[0] == (0x201, "0f 00 f4 01")  # 500 per mille of 1.5 A


def test_profile_may_tell_that_bit_12_stays_0(connect: Connect) -> None:
    bus, port = connect(servo())
    driver = wheel(bus, profile={**ABOUT, "torque": {"follows_bit": False}})
    driver.open()
    driver.arm()
    for status in (OFF, 0x0231, 0x0233, 0x0237):
        feedback(port, status)
        cycle(driver, port, 0.0)
    assert driver.ready()


@pytest.mark.parametrize(
    ("speed", "options", "unit"),
    [
        ({"velocity_counts": "0.1 count/s"}, {}, 0.1 * 2 * math.pi / 4096),
        ({"velocity_unit": "1 rpm"}, {}, 2 * math.pi / 60),
        ({"velocity_unit": "1 rpm"}, {"velocity_unit": "0.1 rpm"}, 0.2 * math.pi / 60),
        ({}, {"velocity_unit": "0.1 rpm"}, 0.2 * math.pi / 60),
    ],
)
def test_unit_of_velocities_is_that_of_the_profile(
    speed: dict[str, Any], options: dict[str, Any], unit: float
) -> None:
    profile = {**ABOUT, "vendor": 0xFB, "speed": speed}
    assert belt_config(profile=profile, **options).unit == pytest.approx(unit)


@pytest.mark.parametrize(
    ("profile", "said"),
    [
        ({"speed": {}}, "does not state the unit of velocities: give 'velocity_unit'"),
        ({"torque": {}}, "has no velocity mode: use the driver cia402-current"),
        ({"speed": {"velocity_unit": "1 rpm", "velocity_counts": "1 count/s"}}, "not both"),
        ({"speed": {"mode": "homing"}}, "cyclic"),
        (
            {"speed": {"target": {"object": "6042:00", "type": "uint16"}}},
            "'target' 6042:00 is of type uint16, which has no sign",
        ),
        (
            {"torque": {"actual": {"object": "2030:00", "type": "int32"}}},
            "object 2030:00 of type int32 does not fit a PDO",
        ),
        ({"pdos": {"command": {"number": 2, "cob_id": 0x200}}}, "RPDOs have the same number: 2, 2"),
        ({"pdos": {"command": {"number": 1, "cob_id": 0x180}}}, "same cob_id: 0x180"),
        ({"setup": [{"object": "6087", "type": "uint8", "value": 1, "name": "n"}]}, "pattern"),
        (
            {"setup": [{"object": "6087:00", "type": "uint8", "value": 256, "name": "slope"}]},
            r"256 does not fit object 6087:00 \(slope\)",
        ),
    ],
)
def test_profile_that_cannot_be_is_refused(profile: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        belt_config(profile={**ABOUT, **profile})


def test_speed_beyond_the_target_object_is_refused(connect: Connect) -> None:
    target = {"object": "60FF:00", "type": "int16"}
    profile = {**ABOUT, "speed": {"velocity_unit": "0.01 rpm", "target": target}}
    drive = servo(2, mode=9)
    del drive.objects[0x60A9, 0]
    bus, _ = connect(drive)
    with pytest.raises(ProtocolError, match=r"takes at most 0\.546 m/s .*`speed_range` is 2\.5"):
        belt(bus, profile=profile).open()


def test_profile_without_torque_is_refused_for_current() -> None:
    with pytest.raises(ValidationError, match="has no torque mode: use the driver cia402-speed"):
        wheel_config(profile={**ABOUT, "speed": {"velocity_unit": "1 rpm"}})


def test_profile_states_unit_of_rated_current(connect: Connect) -> None:
    drive = servo()
    drive.objects |= {(0x1018, 1): number(0x26C, 4), (0x203B, 1): number(1800, 4)}
    del drive.objects[0x6076, 0]
    bus, _ = connect(drive)
    driver = wheel(bus, profile="nanotec", current_range="1 A")
    driver.open()
    assert "1000 per mille = 1.8 A by object 203B:01" in driver.identity


def test_belt_is_commanded_in_unit_of_profile(connect: Connect) -> None:
    drive = servo(node=2, mode=9)
    drive.objects |= {(0x1018, 1): number(0x9A, 4), (0x6076, 0): number(1000, 4)}
    del drive.objects[0x60A9, 0]
    drive.objects |= {(index, sub): number(1, 4) for index in (0x6090, 0x6096) for sub in (1, 2)}
    bus, port = connect(drive)
    driver = belt(bus, profile="elmo-gold", clutch=False)
    driver.open()
    driver.arm()
    for status in (OFF, 0x0231, 0x0233, ENABLED):
        port.say(0x182, number(status, 2) + number(0, 2) + number(0, 4))
        port.say(0x282, number(0, 4))
        cycle(driver, port, 0.0)
    assert driver.ready()
    port.say(0x182, number(ENABLED, 2) + number(0, 2) + number(0, 4))
    port.say(0x282, number(0, 4))
    # 0.1 m/s at 100 mm a revolution is one a second: 4096 counts per second.
    assert cycle(driver, port, 0.1)[0] == (0x202, "0f 00 00 10 00 00")


ENCODER: dict[str, Any] = {
    **ABOUT,
    "vendor": 0xFB,
    "setup": [{"object": "6000:00", "type": "uint16", "value": 4, "name": "scaling on"}],
    "expect": [{"object": "6501:00", "type": "uint32", "value": 4096, "name": "steps"}],
    "pdo": {"number": 2, "cob_id": 0x280},
}


def test_encoder_is_set_up_by_its_profile(connect: Connect) -> None:
    node = scripted_encoder()
    node.objects |= {
        (0x6000, 0): number(0, 2),
        (0x6001, 0): number(360, 4),
        (0x6002, 0): number(3600, 4),
    }
    bus, port = connect(node)
    driver = encoder(bus, profile=ENCODER)
    driver.open()
    assert node.objects[0x6000, 0] == number(4, 2)
    assert node.objects[0x1801, 1] == number(0x4000_028B, 4)
    assert node.objects[0x1800, 1][3] & 0x80
    assert "profile Test drive (from the manual" in driver.identity
    port.say(0x28B, number(190, 4))
    bus.begin(0)
    row = driver.read(0)
    bus.end(0)
    assert row is not None
    assert row[0] == pytest.approx(math.pi / 2)  # 90 of the 360 units that 6001 has


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"vendor": 0x1}, "vendor id 0xFB .* expects 0x1"),
        (
            {"expect": [{"object": "6501:00", "type": "uint32", "value": 8192, "name": "steps"}]},
            r"6501:00 \(steps\) is 4096, the profile of the Test drive expects 8192",
        ),
    ],
)
def test_encoder_that_contradicts_its_profile_is_refused(
    connect: Connect, changed: dict[str, Any], said: str
) -> None:
    bus, _ = connect(scripted_encoder())
    with pytest.raises(ProtocolError, match=said):
        encoder(bus, profile={**ENCODER, **changed}).open()
