"""A device with an EDS: what this forbids is refused by name, before anything is sent."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from support.can.bench import Connect, belt, belt_config, encoder, wheel, wheel_config
from support.can.eds import line_of, write_eds
from support.can.script import encoder as scripted_encoder
from support.can.script import number, servo

from rigd.sdk import ProtocolError
from rigd_drivers.can.bus import CanBusConfig
from rigd_drivers.can.canopen import objects
from rigd_drivers.can.canopen.sheet import read_sheet
from rigd_drivers.can.cia402_servo.current import CurrentServo
from rigd_drivers.can.cia402_servo.servo import Servo
from rigd_drivers.can.cia402_servo.speed import SpeedServo
from rigd_drivers.can.cia406_encoder import EncoderConfig
from rigd_drivers.can.node import Node

#: The option that a scripted drive needs beside its EDS.
RATED = {"rated_torque": "44.25 mN m", "torque_constant": "29.5 mN m/A"}


def eds_of(tmp_path: Path, kind: str = "servo", **changes: str | None) -> str:
    spelt = {name.replace("__", "/"): value for name, value in changes.items()}
    return str(write_eds(tmp_path / f"{kind}.eds", spelt, kind))


@pytest.mark.parametrize("make", [wheel, belt])
def test_device_that_fits_its_eds_is_opened_alike(
    connect: Connect, tmp_path: Path, make: Callable[..., Servo[Any]]
) -> None:
    plain, checked = servo(2, mode=9), servo(2, mode=9)
    if make is wheel:
        plain, checked = servo(2), servo(2)
    bus, without = connect(plain)
    make(bus, node=2).open()
    bus, with_eds = connect(checked)
    driver = make(bus, node=2, eds=eds_of(tmp_path))
    assert driver.contradictions(driver.config, bus.config) == []
    driver.open()
    assert with_eds.sent == without.sent
    assert checked.objects == plain.objects


def test_an_encoder_that_fits_its_eds_is_opened(connect: Connect, tmp_path: Path) -> None:
    node = scripted_encoder()
    bus, _ = connect(node)
    encoder(bus, eds=eds_of(tmp_path, "encoder")).open()
    assert node.state == 0x05


@pytest.mark.parametrize(
    ("where", "value", "message"),
    [
        ("6502", None, "there is no object 0x6502 (supported drive modes)"),
        ("6041__PDOMapping", "0", "0x6041 Statusword cannot be mapped to TPDO1"),
        ("6071__AccessType", "ro", "0x6071 Target torque is read only (ro)"),
        ("6077__DataType", "0x0004", "0x6077 Torque actual value has 4 bytes, this driver expects"),
        ("6060__HighLimit", "9", "0x6060 Modes of operation is at most 9, not 10"),
        ("6007__LowLimit", "3", "0x6007 Abort connection option code is at least 3, not 2"),
        ("1016sub1__AccessType", "ro", "0x1016:01 Consumer heartbeat time, Consumer heartbeat"),
        ("1400", None, "there is no object 0x1400:01 (COB-id of RPDO1)"),
        ("1A00sub3", None, "there is no object 0x1A00:03"),
        ("1000__DefaultValue", "0x00020191", "this is a device of profile 401, this driver is for"),
        ("DeviceInfo__BaudRate_1000", "0", "the link has 1000 kbit/s"),
        ("6071__HighLimit", "1000", "at most 1000, not 1333, which `current_range` allows"),
    ],
)
def test_values_forbidden_by_eds_are_found_without_bus(
    connect: Connect, tmp_path: Path, where: str, value: str | None, message: str
) -> None:
    name, _, key = where.partition("__")
    if value is None:  # the object with all of its parts
        parts = [name, *(f"{name}sub{sub:X}" for sub in range(9))]
        text = write_eds(tmp_path / "all.eds", {}).read_text()
        changes: dict[str, str | None] = {part: None for part in parts if f"[{part}]" in text}
    else:
        changes = {f"{name}/{key}": value}
    path = write_eds(tmp_path / "servo.eds", changes)
    bus, port = connect(servo())
    driver = wheel(bus, eds=str(path), **RATED)
    told = driver.contradictions(driver.config, bus.config)
    assert len([each for each in told if message in each]) == 1
    if key and name != "DeviceInfo":
        assert told[0].startswith(f"servo.eds:{line_of(path, name, key)}: ")
    with pytest.raises(ProtocolError, match="CiA 402 servo") as caught:
        driver.open()
    assert message in str(caught.value)
    assert "correct `eds`" in str(caught.value)
    assert port.sent == []


def test_range_reported_by_drive_is_checked_against_eds(connect: Connect, tmp_path: Path) -> None:
    """Without `rated_torque` the largest target is known once the drive has been asked."""
    bus, port = connect(servo())
    driver = wheel(bus, eds=eds_of(tmp_path, **{"6071__LowLimit": "-1000"}))
    assert driver.contradictions(driver.config, bus.config) == []
    with pytest.raises(ProtocolError, match=r"-1000, .*-1333, .*`current_range`"):
        driver.open()
    assert not [data for to, data in port.sent if to == 0x601 and data[1:3] == b"\x40\x60"]


def test_speed_beyond_limits_of_target_is_found(tmp_path: Path) -> None:
    config = belt_config(eds=eds_of(tmp_path, **{"60FF__HighLimit": "1000000"}))
    (told,) = SpeedServo.contradictions(config, None)
    assert told.endswith(
        "0x60FF Target velocity is at most 1000000, not 1500000, which `speed_range` allows"
    )


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("VendorNumber", "0x9A", "its vendor is 0xFB, servo.eds is of one with 0x9A (rigd (simul"),
        ("ProductNumber", "0x403", "its product is 0x402, servo.eds is of one with 0x403"),
        ("RevisionNumber", "0x20000", "its major revision is 0x1, servo.eds is of one with 0x2"),
    ],
)
def test_another_device_than_that_of_eds_is_refused(
    connect: Connect, tmp_path: Path, key: str, value: str, message: str
) -> None:
    drive = servo()
    drive.objects |= {(0x1018, 2): number(0x402, 4), (0x1018, 3): number(0x1_0007, 4)}
    before = dict(drive.objects)
    bus, _ = connect(drive)
    with pytest.raises(ProtocolError, match="node 1") as caught:
        wheel(bus, eds=eds_of(tmp_path, **{f"DeviceInfo__{key}": value})).open()
    assert message in str(caught.value)
    assert drive.objects == before  # nothing was written


def test_eds_with_other_minor_revision_is_accepted(connect: Connect, tmp_path: Path) -> None:
    drive = servo()
    drive.objects |= {(0x1018, 2): number(0x402, 4), (0x1018, 3): number(0x1_0007, 4)}
    bus, _ = connect(drive)
    driver = wheel(bus, eds=eds_of(tmp_path))
    driver.open()
    assert "revision 0x10007" in driver.identity


def test_only_objects_of_the_eds_are_read(connect: Connect, tmp_path: Path) -> None:
    bus, port = connect(servo())
    node = Node(bus, 1, read_sheet(write_eds(tmp_path / "x.eds", {"6502": None})))
    node.attach()
    with pytest.raises(ProtocolError, match=r"x\.eds: there is no object 0x6502"):
        node.read(objects.SUPPORTED_MODES)
    assert port.sent == []


def test_identity_that_either_side_leaves_open_fits(connect: Connect, tmp_path: Path) -> None:
    open_in_file = {"DeviceInfo__VendorNumber": "0", "DeviceInfo__ProductNumber": ""}
    bus, _ = connect(servo())
    wheel(bus, eds=eds_of(tmp_path, **open_in_file)).open()


def test_messages_name_objects_as_the_eds_does(connect: Connect, tmp_path: Path) -> None:
    drive = servo()
    drive.refuse[0x6060, 0] = 0x08000022
    bus, _ = connect(drive)
    name = "Mode, as in chapter 3"
    with pytest.raises(ProtocolError, match=f"to 0x6060 {name}: abort 0x08000022"):
        wheel(bus, eds=eds_of(tmp_path, **{"6060__ParameterName": name})).open()


def test_objects_missing_in_the_eds_are_still_used(connect: Connect, tmp_path: Path) -> None:
    """RPDOs of the scripted drive have an event timer; the EDS has none."""
    drive = servo()
    drive.objects[0x1400, 5] = bytes(2)
    bus, _ = connect(drive)
    wheel(bus, eds=eds_of(tmp_path)).open()
    assert drive.objects[0x1400, 5] == number(100, 2)


def test_drive_is_made_safe_with_any_eds(connect: Connect, tmp_path: Path) -> None:
    drive = servo()
    bus, _ = connect(drive)
    wheel(bus, eds=eds_of(tmp_path, **{"6040__AccessType": "ro"})).rescue()
    assert drive.objects[0x6040, 0] == b"\0\0"


@pytest.mark.parametrize(
    ("node", "bitrate", "message"),
    [(2, 1e6, "servo.eds is of node 2, `node` is 1"), (1, 5e5, "set to 500 kbit/s, the link has")],
)
def test_dcf_of_other_node_or_bitrate_is_found(
    tmp_path: Path, node: int, bitrate: float, message: str
) -> None:
    path = write_eds(tmp_path / "servo.eds", {})
    section = f"\n[DeviceComissioning]\nNodeID={node}\nBaudrate={bitrate / 1e3:.0f}\n"
    path.write_text(path.read_text() + section)
    link = CanBusConfig(interface="hub")
    (told,) = CurrentServo.contradictions(wheel_config(eds=str(path)), link)
    assert message in told


def test_wrong_or_missing_eds_is_wrong_option(tmp_path: Path) -> None:
    path = eds_of(tmp_path, "encoder", **{"6004__DataType": "long"})
    with pytest.raises(ValidationError, match=r"encoder\.eds:\d+:1: .*\[6004\] .*'long'"):
        EncoderConfig.model_validate({"node": 1, "kind": "rotary", "eds": path})
    with pytest.raises(ValidationError, match=r"no EDS 'my\.eds'"):
        EncoderConfig.model_validate(
            {"node": 1, "kind": "rotary", "eds": "my.eds"}, context={"folder": tmp_path}
        )


def test_eds_is_found_beside_rig_file_or_shipped(tmp_path: Path) -> None:
    options = {"node": 1, "kind": "rotary", "eds": "eds/rigd_encoder.eds"}
    shipped = EncoderConfig.model_validate(options, context={"folder": tmp_path})
    assert shipped.eds is not None
    assert Path(shipped.eds).is_file()
    beside = write_eds(tmp_path / "mine.eds", {}, "encoder")
    config = EncoderConfig.model_validate(
        options | {"eds": "mine.eds"}, context={"folder": tmp_path}
    )
    assert config.eds == str(beside)
