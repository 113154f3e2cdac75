"""Opening a drive: what is written, and every refusal with what to change."""

from __future__ import annotations

import time

import pytest
from support.can.bench import (
    Clock,
    Connect,
    belt,
    belt_config,
    encoder,
    encoder_config,
    wheel,
    wheel_config,
)
from support.can.script import ScriptedServo, number, servo
from support.can.script import encoder as scripted_encoder

from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd_drivers.can.bus import CanBus, CanBusConfig
from rigd_drivers.can.canopen import objects
from rigd_drivers.can.cia402_servo.current import CurrentServo
from rigd_drivers.can.cia402_servo.speed import SpeedServo
from rigd_drivers.can.cia406_encoder import Cia406Encoder
from rigd_drivers.can.node import Node


def test_drive_is_left_operational_switched_off_and_mapped(connect: Connect) -> None:
    drive = servo()
    bus, port = connect(drive)
    driver = wheel(bus)
    driver.open()
    kept = drive.objects
    assert drive.state == 0x05
    assert kept[0x6041, 0] == number(0x0250, 2)
    assert kept[0x1016, 1] == bytes.fromhex("64 00 7F 00")  # node 127, 100 ms
    assert kept[0x6007, 0] == b"\x02\x00"
    assert kept[0x6060, 0] == b"\x0a"
    assert kept[0x6071, 0] == b"\x00\x00"
    assert kept[0x1400, 1] == number(0x201, 4)
    assert kept[0x1600, 0] == b"\x02"
    assert [kept[0x1600, sub].hex() for sub in (1, 2)] == ["10004060", "10007160"]
    assert kept[0x1800, 1] == number(0x4000_0181, 4)
    assert kept[0x1800, 2] == b"\x01"
    assert kept[0x1800, 3] == b"\x00\x00"  # no inhibit time
    assert [kept[0x1A00, sub].hex() for sub in (1, 2, 3)] == ["10004160", "10007760", "20006460"]
    unused = [(0x1401, 1), (0x1801, 1), (0x1802, 1), (0x1803, 1)]
    assert all(kept[address][3] & 0x80 for address in unused)
    assert driver.identity == (
        "Test, vendor 0xFB, serial number 4711, 1000 per mille = 1.5 A by object 6076 "
        "(44250 x 1e-06 N m) over object 3001:05 (0.0295 N m/A)"
    )
    # Never enabled on the way: no controlword but "disable voltage".
    words = [data[4:6] for to, data in port.sent if to == 0x601 and data[:4].hex() == "2b406000"]
    assert set(words) == {b"\x00\x00"}


def test_mapping_is_written_while_pdo_is_off(connect: Connect) -> None:
    bus, port = connect(servo())
    wheel(bus).open()
    writes = [data for to, data in port.sent if to == 0x601 and data[0] >> 5 == 1]
    order = [data.hex(" ") for data in writes if data[1:3] in (b"\x00\x1a", b"\x00\x18")]
    assert order == [
        "23 00 18 01 81 01 00 80",
        "2f 00 18 02 01 00 00 00",
        "2b 00 18 03 00 00 00 00",
        "2f 00 1a 00 00 00 00 00",
        "23 00 1a 01 10 00 41 60",
        "23 00 1a 02 10 00 77 60",
        "23 00 1a 03 20 00 64 60",
        "2f 00 1a 00 03 00 00 00",
        "23 00 18 01 81 01 00 40",
    ]


def test_fixed_mapping_is_accepted_if_right(connect: Connect) -> None:
    node = scripted_encoder()
    node.objects |= {(0x1A00, 0): b"\x01", (0x1A00, 1): number(0x6004_0020, 4)}
    node.refuse = {(0x1A00, sub): 0x0601_0002 for sub in range(5)}
    bus, _ = connect(node)
    driver = encoder(bus)
    driver.open()
    assert node.objects[0x1800, 2] == b"\x01"  # at every SYNC
    assert node.objects[0x1800, 1] == number(0x4000_018B, 4)
    node.refuse[0x1800, 1] = 0x0601_0002  # its COB-id as well
    driver.open()
    driver.close()
    node.objects[0x1A00, 1] = number(0x6008_0040, 4)  # and refused if not
    with pytest.raises(ProtocolError, match="it is read only") as caught:
        encoder(bus).open()
    assert "make it variable" in (caught.value.hint or "")


@pytest.mark.parametrize(
    ("address", "code", "message", "hint"),
    [
        ((0x1A00, 1), 0x06040041, r"1A00:01 .*cannot be mapped to a PDO", "update it"),
        ((0x1A00, 3), 0x06040042, r"1A00:03 .*exceed the length of a PDO", "fewer objects"),
        ((0x1600, 0), 0x06010002, r"1600:00 .*it is read only", "make it variable"),
        ((0x1400, 1), 0x08000022, r"1400:01 .*present state of the device", "off and on"),
        ((0x1016, 1), 0x06020000, r"1016:01 .*object does not exist", "update it"),
        ((0x6007, 0), 0x06090030, r"6007:00 .*out of range", ""),
    ],
)
def test_refused_set_up_names_object_abort_and_remedy(
    connect: Connect, address: tuple[int, int], code: int, message: str, hint: str
) -> None:
    drive = servo()
    drive.refuse[address] = code
    bus, _ = connect(drive)
    with pytest.raises(ProtocolError, match=message) as caught:
        wheel(bus).open()
    assert f"0x{code:08X}" in caught.value.message
    assert hint in (caught.value.hint or "")
    assert drive.state != 0x05  # not operational: it ignores PDOs


@pytest.mark.parametrize("address", [(0x1016, 1), (0x6007, 0), (0x1A00, 2), (0x1017, 0)])
def test_setting_that_does_not_read_back_is_refused(
    connect: Connect, address: tuple[int, int]
) -> None:
    drive = servo()
    drive.stuck.add(address)
    bus, _ = connect(drive)
    with pytest.raises(ProtocolError, match=f"{address[0]:04X}:{address[1]:02X} .*reads back"):
        wheel(bus).open()


def test_drive_that_states_no_sizes_is_read(connect: Connect) -> None:
    drive = servo()
    drive.sized = False
    drive.objects[0x6071, 0] = number(-5, 2)
    bus, _ = connect(drive)
    node = Node(bus, 1)
    node.attach()
    assert node.read(objects.STATUSWORD) == 0x0250
    assert node.read_optional(objects.TARGET_TORQUE) == -5
    driver = wheel(bus)
    driver.open()
    assert drive.state == 0x05


def changed(address: tuple[int, int], value: bytes) -> ScriptedServo:
    drive = servo()
    drive.objects[address] = value
    return drive


@pytest.mark.parametrize(
    ("drive", "options", "message"),
    [
        (changed((0x1000, 0), number(0x196, 4)), {}, "device profile 406 .*expected 402"),
        (servo(), {"serial": 4712}, "serial number 4711, the rig file expects 4712"),
        (servo(mode=9), {}, r"does not offer the cyclic torque mode \(10\): object 6502 is 0x100"),
        (servo(), {"rated_torque": "60 mN m"}, "rated torque .* 0.06 N m by `rated_t"),
        (servo(), {"torque_constant": "50 mN m/A"}, "torque constant .* 0.0295 N m/A by object 3"),
        (changed((0x6076, 0), number(0, 4)), {}, "does not report what 1000 per mille"),
        (changed((0x6076, 0), number(100, 4)), {}, "at most 0.111 A"),
    ],
)
def test_device_other_than_in_rig_file_is_refused(
    connect: Connect, drive: ScriptedServo, options: dict[str, object], message: str
) -> None:
    bus, _ = connect(drive)
    with pytest.raises(ProtocolError, match=message):
        wheel(bus, **options).open()


def test_drive_that_would_cut_current_is_refused(connect: Connect) -> None:
    drive = servo()
    drive.objects[0x3001, 2] = number(1999, 4)
    bus, _ = connect(drive)
    driver = wheel(bus)
    with pytest.raises(ProtocolError, match=r"limits its current to 1.999 A .*is 2 A"):
        driver.open()
    drive.objects[0x3001, 2] = number(2000, 4)
    driver.open()


def test_another_unit_of_velocity_is_refused_with_both(connect: Connect) -> None:
    drive = servo(2, mode=9)
    drive.objects[0x60A9, 0] = number(0x00B44700, 4)  # 1 rpm
    bus, _ = connect(drive)
    driver = belt(bus)
    with pytest.raises(ProtocolError, match=r"units of 1 rpm .*has 0.001 rpm"):
        driver.open()
    driver.close()
    belt(bus, velocity_unit="1 rpm").open()


@pytest.mark.parametrize("reported", [None, 0])
def test_unknown_unit_of_velocity_is_refused(connect: Connect, reported: int | None) -> None:
    drive = servo(2, mode=9)
    del drive.objects[0x60A9, 0]
    if reported is not None:
        drive.objects[0x60A9, 0] = number(reported, 4)
    bus, _ = connect(drive)
    driver = belt(bus)
    with pytest.raises(ProtocolError, match=r"node 2 .*unit of its velocities") as caught:
        driver.open()
    assert "velocity_unit" in (caught.value.hint or "")
    driver.close()
    belt(bus, velocity_unit="1 rpm").open()


def test_silent_node_is_named_with_those_that_answer(connect: Connect) -> None:
    bus, port = connect(servo(3), scripted_encoder())
    port.say(0x702, "05")
    with pytest.raises(LinkError, match=r"node 1 .*does not .*found: 2, 3, 11") as caught:
        wheel(bus).open()
    assert "1000 kbit/s" in (caught.value.hint or "")


def test_empty_bus_is_an_error(connect: Connect) -> None:
    bus, _ = connect()
    with pytest.raises(LinkError, match=r"node 1 .*does not .*no node was found"):
        wheel(bus).open()


def test_error_frames_only_suggest_a_wrong_bitrate(connect: Connect) -> None:
    drive = servo()
    drive.silent = True
    bus, port = connect(drive)
    bus.subscribe(0x702, lambda _: port.say(0x2000_0008, bytes(8)))
    port.say(0x702, "05")
    with pytest.raises(LinkError, match=r"node 1 does not answer, .*errors \(1\)") as caught:
        wheel(bus).open()
    assert "bitrate" in (caught.value.hint or "")


def test_two_nodes_with_same_id_are_detected(connect: Connect) -> None:
    drive = servo()
    drive.replies = 2
    bus, _ = connect(drive)
    with pytest.raises(ProtocolError, match=r"1000:00|two nodes answer under node id 1"):
        wheel(bus).open()


def test_rig_file_with_two_equal_ids_is_refused(connect: Connect) -> None:
    first = servo()
    bus, _ = connect(first)
    wheel(bus).open()
    second = belt(bus, node=1)
    with pytest.raises(ProtocolError, match=r"two devices .*node id 1"):
        second.open()
    second.close()
    assert first.state == 0x05  # still operational: it is not the second one's
    with pytest.raises(ProtocolError, match=r"node id 127 .*is rigd's own"):
        wheel(bus, node=127).open()


def test_drive_can_be_opened_again_after_failure(connect: Connect) -> None:
    drive = servo()
    drive.refuse[0x1600, 0] = 0x06010002
    bus, _ = connect(drive)
    driver = wheel(bus)
    with pytest.raises(ProtocolError):
        driver.open()
    drive.refuse.clear()
    driver.open()
    driver.open()
    driver.close()
    driver.close()
    assert drive.state == 0x7F


def test_a_node_that_does_not_start_is_refused(connect: Connect) -> None:
    drive = servo()
    drive.beats = False
    bus, _ = connect(drive)
    with pytest.raises(ProtocolError, match=r"not operational .*no heartbeat"):
        wheel(bus).open()


def test_a_fault_that_can_be_reset_is_reset(connect: Connect) -> None:
    drive = changed((0x6041, 0), number(0x0218, 2))
    bus, _ = connect(drive)
    wheel(bus).open()
    assert drive.objects[0x6041, 0] == number(0x0250, 2)


def test_persistent_fault_is_reported_with_its_cause(connect: Connect) -> None:
    drive = changed((0x6041, 0), number(0x0218, 2))
    drive.stuck.add((0x6040, 0))
    drive.objects[0x1003, 1] = number(0x3220, 4)
    bus, _ = connect(drive)
    with pytest.raises(DeviceError, match=r"stays in fault; .*0x3220"):
        wheel(bus).open()


def test_watchdog_that_does_not_act_is_no_watchdog(connect: Connect) -> None:
    drive = servo()
    bus, port = connect(drive)
    driver = wheel(bus)
    driver.open()
    first = len(port.sent)
    with pytest.raises(DeviceError, match=r"0\.200 s .* measured: 0\.[2-9]"):
        driver.prove_watchdog()
    assert drive.objects[0x6041, 0] == number(0x0250, 2)  # switched off all the same
    sent = [identifier for identifier, _ in port.sent[first:]]
    assert 0x77F in sent
    assert 0x080 not in sent
    assert 0x201 not in sent


class Tripping(ScriptedServo):
    """A drive that switches itself off 100 ms after the last heartbeat, on a host that stalls."""

    def __init__(self, clock: Clock, stalls: list[float]) -> None:
        super().__init__(1, servo().objects)
        self.clock = clock
        self.stalls = stalls
        self.beat_ns = 0

    def hear(self, identifier: int, data: bytes) -> None:
        silent_ns = time.monotonic_ns() - self.beat_ns
        if identifier == 0x77F:
            self.beat_ns = time.monotonic_ns()
        elif silent_ns > 100_000_000 and self.objects[0x6041, 0] == number(0x1237, 2):
            self.objects[0x6041, 0] = number(0x0218, 2)
            if self.stalls:
                self.clock.pass_by(self.stalls.pop())
        super().hear(identifier, data)


@pytest.mark.parametrize(("stalls", "proven"), [([], True), ([1.0], True), ([1.0, 1.0], False)])
def test_stall_of_this_host_proves_no_watchdog(
    connect: Connect, clock: Clock, stalls: list[float], proven: bool
) -> None:
    drive = Tripping(clock, stalls)
    bus, _ = connect(drive)
    driver = wheel(bus)
    driver.open()
    if proven:
        assert 0.1 < driver.prove_watchdog() < 0.2
    else:
        with pytest.raises(DeviceError, match=r"did not switch itself off .* measured: 1"):
            driver.prove_watchdog()
    assert drive.objects[0x6041, 0] == number(0x0250, 2)
    assert drive.state == 0x05


class Dropping(ScriptedServo):
    """A drive that loses its torque at the last heartbeat, and reports ``code`` if it has one."""

    def __init__(self, status: int, code: int | None) -> None:
        super().__init__(1, servo().objects)
        self.status, self.code = status, code

    def hear(self, identifier: int, data: bytes) -> None:
        if identifier == 0x77F and self.objects[0x6041, 0] == number(0x1237, 2):
            self.objects[0x6041, 0] = number(self.status, 2)
            if self.code is not None:
                self.outputs.append((0x081, number(self.code, 2) + bytes(6)))
        super().hear(identifier, data)


@pytest.mark.parametrize(
    ("status", "code", "words"),
    [
        (0x0218, 0x3220, r"cannot have acted yet; emergency 0x3220 \(supply undervoltage\)"),
        (0x0250, None, r"cannot have acted yet\n"),  # safe torque off
    ],
)
def test_torque_lost_too_early_proves_no_watchdog(
    connect: Connect, status: int, code: int | None, words: str
) -> None:
    bus, _ = connect(Dropping(status, code))
    driver = wheel(bus, watchdog="5 s")
    driver.open()
    early = r"lost its torque \d\.\d{3} s .* its watchdog of 5 s "
    with pytest.raises(DeviceError, match=early + words):
        driver.prove_watchdog()


def test_early_report_of_silence_proves_watchdog(connect: Connect) -> None:
    bus, _ = connect(Dropping(0x0218, 0x8130))
    driver = wheel(bus, watchdog="5 s")
    driver.open()
    assert driver.prove_watchdog() < 5.0


def test_a_drive_without_power_cannot_be_proven(connect: Connect) -> None:
    drive = servo()
    bus, port = connect(drive)
    driver = wheel(bus)
    driver.open()
    drive.stuck.add((0x6040, 0))
    first = len(port.sent)
    with pytest.raises(DeviceError, match="switch on disabled, expected ready") as caught:
        driver.prove_watchdog()
    assert port.sent[first:].count((0x201, bytes(4))) == 2  # made safe all the same
    assert "supply" in (caught.value.hint or "")


def test_watchdog_shorter_than_three_heartbeats_is_refused(connect: Connect) -> None:
    link = CanBusConfig(interface="hub")
    (reason,) = CurrentServo.contradictions(wheel_config(watchdog="50 ms"), link)
    assert "50 ms is shorter than 3 heartbeats (60 ms)" in reason
    assert CurrentServo.contradictions(wheel_config(watchdog="60 ms"), link) == []


def test_rpdo_timer_is_set_if_it_exists(connect: Connect) -> None:
    drive = servo()
    drive.objects[0x1400, 5] = number(0, 2)
    bus, _ = connect(drive)
    wheel(bus).open()
    assert drive.objects[0x1400, 5] == number(100, 2)  # written while the PDO is invalid


def test_drivers_declare_channels_and_setpoints() -> None:
    servo_ = CurrentServo.declare(wheel_config())
    axis = SpeedServo.declare(belt_config())
    unclutched = SpeedServo.declare(belt_config(clutch=False))
    angle = Cia406Encoder.declare(encoder_config())
    assert [(c.name, c.unit) for c in servo_.channels] == [
        ("current", "A"), ("current_raw", "1"), ("angle", "rad"), ("counts", "count"),
    ]  # fmt: skip
    assert [(c.name, c.low, c.high) for c in servo_.setpoints] == [("current", -2.0, 2.0)]
    assert [c.name for c in axis.channels] == ["position", "speed", "force"]
    assert [c.name for c in axis.setpoints] == ["speed", "engaged"]
    assert [c.name for c in unclutched.setpoints] == ["speed"]
    assert [c.name for c in angle.channels] == ["angle", "counts"]


def test_unopened_drivers_are_made_safe_silently() -> None:
    bus = CanBus(CanBusConfig(interface="hub"))
    for driver in (wheel(bus), belt(bus), encoder(bus)):
        driver.make_safe()
        driver.close()


@pytest.mark.parametrize(
    ("objects", "options", "message"),
    [
        ({(0x6501, 0): number(1024, 4)}, {"counts_per_revolution": "4096 count/rev"}, "has 1024"),
        ({(0x6501, 0): number(0, 4)}, {}, "does not report its resolution"),
        ({}, {"bits": 25}, "24 bits; the rig file has 25"),
        ({(0x6004, 0): number(1 << 24, 4)}, {}, "beyond its range of 16777216"),
        ({(0x1000, 0): number(0x20192, 4)}, {}, "profile 402 .*expected 406"),
    ],
)
def test_encoder_other_than_in_rig_file_is_refused(
    connect: Connect,
    objects: dict[tuple[int, int], bytes],
    options: dict[str, object],
    message: str,
) -> None:
    node = scripted_encoder()
    node.objects |= objects
    bus, _ = connect(node)
    with pytest.raises(ProtocolError, match=message):
        encoder(bus, **options).open()


def test_options_of_other_kind_of_encoder_are_refused() -> None:
    with pytest.raises(ValueError, match="'gear_ratio' belongs to 'kind: rotary'"):
        encoder_config(kind="linear", distance_per_count="30 um/count", gear_ratio=2)
    with pytest.raises(ValueError, match="needs 'distance_per_count'"):
        encoder_config(kind="linear")
