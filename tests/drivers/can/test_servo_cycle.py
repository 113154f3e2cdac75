"""A drive in the cycle: bytes sent, rows made, and every way it fails."""

from __future__ import annotations

import math

import pytest
from support.can.bench import (
    ENABLED,
    OFF,
    Clock,
    Connect,
    belt,
    cycle,
    enabled,
    encoder,
    feedback,
    wheel,
)
from support.can.script import ScriptedServo, number, servo
from support.can.script import encoder as scripted_encoder

from rigd.sdk import DeviceError, ProtocolError
from rigd_drivers.can.cia402_servo.current import CurrentServo
from rigd_drivers.can.cia402_servo.rotary import RotaryServo, RotaryServoConfig
from rigd_drivers.can.cia402_servo.speed import CLUTCH_ENGAGED
from rigd_drivers.can.cia402_servo.velocity import velocity_unit


def test_enabling_sends_one_controlword_per_cycle_without_torque(connect: Connect) -> None:
    bus, port = connect(servo())
    driver = wheel(bus)
    driver.open()
    feedback(port, OFF)
    sent = cycle(driver, port, 1.0)
    assert sent == [(0x000, "01 01"), (0x201, "00 00 00 00"), (0x080, "")]
    driver.arm()
    words = []
    for status in (OFF, 0x0231, 0x0233, ENABLED):
        assert not driver.ready()
        feedback(port, status)
        words.append(cycle(driver, port, 1.0))
    assert driver.ready()
    assert words == [
        [(0x201, "06 00 00 00"), (0x080, "")],
        [(0x201, "07 00 00 00"), (0x080, "")],
        [(0x201, "0f 00 00 00"), (0x080, "")],
        # 1 A x 29.5 mN m/A = 29.5 mN m, of 44.25 mN m: 667 per mille.
        [(0x201, "0f 00 9b 02"), (0x080, "")],
    ]


@pytest.mark.parametrize(
    ("inverted", "data", "row"),
    [
        (False, "37 12 9B 02 00 04 00 00", (1.0005, 667, 2 * math.pi, 1024, ENABLED)),
        (True, "37 12 9B 02 00 04 00 00", (-1.0005, 667, -2 * math.pi, 1024, ENABLED)),
        (False, "37 12 FF FF FF FF FF FF", (-0.0015, -1, -2 * math.pi / 1024, -1, ENABLED)),
    ],
)
def test_row_contains_the_received_values(
    connect: Connect, inverted: bool, data: str, row: tuple[float, ...]
) -> None:
    driver, port = enabled(connect, inverted=inverted)
    port.say(0x181, data)
    driver.link.begin(0)
    assert driver.read(0) == pytest.approx(row)


@pytest.mark.parametrize(("watchdog_s", "silent_s"), [(0.02, 0.1), (0.1, 0.1), (0.3, 0.3)])
def test_silent_drive_fails_not_before_its_watchdog(
    connect: Connect, watchdog_s: float, silent_s: float
) -> None:
    bus, _ = connect(servo())
    assert wheel(bus, watchdog=f"{watchdog_s} s").declaration.silent_s == silent_s


def test_cycle_without_data_gives_no_row(connect: Connect) -> None:
    driver, _ = enabled(connect)
    driver.link.begin(0)
    assert driver.read(0) is None


def test_setpoint_is_held_within_range_of_drive(connect: Connect) -> None:
    driver, port = enabled(connect)
    feedback(port, ENABLED)
    assert cycle(driver, port, -99.0)[0] == (0x201, "0f 00 cb fa")  # -2 A: -1333 per mille


def test_setpoint_that_is_nan_is_refused(connect: Connect) -> None:
    driver, _ = enabled(connect)
    with pytest.raises(DeviceError, match=r"'current' is NaN; .*-2 to 2 A"):
        driver.write([float("nan")])


def test_angle_begins_at_opening_and_passes_counter_end(
    connect: Connect,
) -> None:
    drive = servo()
    drive.objects[0x6064, 0] = number(2**31 - 10, 4)
    bus, port = connect(drive)
    driver = wheel(bus)
    driver.open()
    angles = []
    for counts in (2**31 - 10, 2**31 - 1, -(2**31), -(2**31) + 9):
        feedback(port, OFF, 0, counts)
        bus.begin(0)
        row = driver.read(0)
        assert row is not None
        angles.append(round(row[2] / (2 * math.pi) * 1024))
        bus.end(0)
    assert angles == [0, 9, 10, 19]


@pytest.mark.parametrize(
    ("low", "high", "shown", "seen"),
    [
        (0, 9999, (9990, 9999, 0, 9), [9990, 9999, 10_000, 10_009]),
        (-5000, 4999, (-4995, 4999, -5000), [-4995, -5001, -5000]),
        (0, 0, (9990, 0), [9990, 0]),  # switched off
        (-(2**31), 2**31 - 1, (2**31 - 1, -(2**31)), [2**31 - 1, 2**31]),
    ],
)
def test_position_that_wraps_at_its_range_is_followed(
    connect: Connect, low: int, high: int, shown: tuple[int, ...], seen: list[int]
) -> None:
    drive = servo()
    drive.objects |= {(0x607B, 1): number(low, 4), (0x607B, 2): number(high, 4)}
    drive.objects[0x6064, 0] = number(shown[0], 4)
    bus, port = connect(drive)
    driver = wheel(bus, zero="0 count")
    driver.open()
    found = []
    for counts in shown:
        feedback(port, OFF, 0, counts)
        bus.begin(0)
        row = driver.read(0)
        assert row is not None
        found.append(row[3])
        bus.end(0)
    assert found == seen


@pytest.mark.parametrize(
    ("frame", "data", "message"),
    [
        (0x081, "10 23 03 00 00 00 00 00", r"emergency 0x2310 \(overcurrent at the output\)"),
        (0x081, "30 81 11 00 00 00 00 00", r"emergency 0x8130 \(heartbeat of the master lost\)"),
        (0x081, "30 81", "an emergency of 2 bytes"),
        (0x701, "00", r"has restarted \(boot-up message\)"),
        (0x701, "42", "a heartbeat of 42"),
        (0x181, "18 02 00 00 00 00 00 00", r"left operation enabled: fault \(statusword 0x0218\)"),
        (0x181, "50 02 00 00 00 00 00 00", "left operation enabled: switch on disabled"),
        (0x181, "37 02 00 00 00 00 00 00", "ignores its target .*bit 12 or 9"),
        (0x181, "37 10 00 00 00 00 00 00", "ignores its target .*bit 12 or 9"),
        (0x181, "37 12 00 00 00 00 00", "has 7 bytes, mapped were 8"),
    ],
)
def test_drive_failing_while_enabled_reports_the_reason(
    connect: Connect, frame: int, data: str, message: str
) -> None:
    driver, port = enabled(connect)
    port.say(frame, data)
    driver.link.begin(0)
    with pytest.raises((DeviceError, ProtocolError), match=message):
        driver.read(0)


def test_lost_master_advice_names_cable_and_cycle(connect: Connect) -> None:
    driver, port = enabled(connect)
    port.say(0x081, "30 81 11 00 00 00 00 00")
    driver.link.begin(0)
    with pytest.raises(DeviceError) as caught:
        driver.read(0)
    hint = caught.value.hint or ""
    assert "frames were lost (check cable" in hint and "the cycle stalled" in hint


def test_node_leaving_operational_is_a_distinct_fault(connect: Connect) -> None:
    driver, port = enabled(connect)
    for _ in range(2):
        port.say(0x701, "7F")
    driver.link.begin(0)
    with pytest.raises(DeviceError, match=r"operational, .*: pre_operational"):
        driver.read(0)


def test_a_lost_heartbeat_is_missed(connect: Connect, clock: Clock) -> None:
    driver, port = enabled(connect)
    port.say(0x701, "05")
    feedback(port, ENABLED)
    cycle(driver, port, 0.0)
    clock.pass_by(0.4)
    feedback(port, ENABLED)
    cycle(driver, port, 0.0)
    clock.pass_by(0.2)
    feedback(port, ENABLED)
    driver.link.begin(0)
    with pytest.raises(DeviceError, match="sent no heartbeat for 6"):
        driver.read(0)


def test_fault_by_own_silence_before_arming_is_reset(connect: Connect) -> None:
    bus, port = connect(servo())
    driver = wheel(bus)
    driver.open()
    port.say(0x081, "30 81 11 00 00 00 00 00")
    port.say(0x701, "7F")
    feedback(port, 0x0218)
    assert (0x000, "01 01") in cycle(driver, port, 0.0)  # operational again
    driver.arm()
    seen = set()
    for _ in range(8):
        feedback(port, 0x0218)
        seen |= set(cycle(driver, port, 0.0))
    assert {(0x201, "00 00 00 00"), (0x201, "80 00 00 00")} <= seen


class Reluctant(ScriptedServo):
    """A drive that is not started before the second order, or never."""

    def __init__(self, orders: int) -> None:
        super().__init__(1, servo().objects)
        self.orders = orders
        self.beats_heard = 0

    def hear(self, identifier: int, data: bytes) -> None:
        self.beats_heard += identifier == 0x77F
        if identifier == 0x000 and data[0] == 0x01 and self.orders:
            self.orders -= bool(self.beats_heard)
            self.outputs.append((0x701, b"\x7f"))
            return
        super().hear(identifier, data)


def test_start_is_repeated_until_node_is_operational(connect: Connect, clock: Clock) -> None:
    drive = Reluctant(0)
    bus, port = connect(drive)
    driver = wheel(bus)
    driver.open()
    drive.orders, drive.state = 3, 0x7F
    cycle(driver, port, 0.0)
    driver.arm()
    for _ in range(4):
        clock.pass_by(0.05)
        cycle(driver, port, 0.0)
    assert drive.state == 0x05
    first = len(port.sent)
    clock.pass_by(0.05)
    cycle(driver, port, 0.0)
    assert (0x000, b"\x01\x01") not in port.sent[first:]


def test_first_heartbeat_comes_before_the_start(connect: Connect) -> None:
    bus, port = connect(servo())
    driver = wheel(bus)
    driver.open()
    first = len(port.sent)
    bus.begin(0)
    bus.end(0)
    assert [to for to, _ in port.sent[first:]][:2] == [0x77F, 0x000]


def test_node_that_refuses_start_is_named(connect: Connect, clock: Clock) -> None:
    drive = Reluctant(0)
    bus, port = connect(drive)
    driver = wheel(bus)
    driver.open()
    drive.orders, drive.state = 1000, 0x7F
    with pytest.raises(DeviceError, match=r"does not become operational: .* pre_operational"):
        for _ in range(100):
            clock.pass_by(0.05)
            cycle(driver, port, 0.0)


def test_start_refused_at_opening_reports_error_objects(connect: Connect) -> None:
    drive = Reluctant(1000)
    drive.objects |= {(0x1001, 0): b"\x01", (0x1003, 1): number(0x5000, 4)}
    bus, _ = connect(drive)
    with pytest.raises(ProtocolError, match=r"register 0x01 \(generic\); last error: 0x5000 \(dev"):
        wheel(bus).open()


def test_fault_while_enabled_is_not_reset(connect: Connect) -> None:
    bus, port = connect(servo())
    driver = wheel(bus)
    driver.open()
    driver.arm()
    for status in (0x0218, OFF, 0x0231):
        feedback(port, status)
        cycle(driver, port, 0.0)
    feedback(port, 0x0218)
    bus.begin(0)
    with pytest.raises(DeviceError, match="went to fault while it was being enabled"):
        driver.read(0)


def test_state_before_make_safe_is_not_ready(connect: Connect) -> None:
    driver, port = enabled(connect)
    driver.make_safe()
    driver.arm()  # in the same cycle
    for status in (ENABLED, OFF, 0x0231, 0x0233):  # the first is from before
        feedback(port, status)
        cycle(driver, port, 1.0)
        assert not driver.ready()
    feedback(port, ENABLED)
    cycle(driver, port, 1.0)
    assert driver.ready()


def test_emergency_of_drive_itself_counts_before_arming_too(connect: Connect) -> None:
    bus, port = connect(servo())
    driver = wheel(bus)
    driver.open()
    port.say(0x081, "20 32 04 00 00 00 00 00")
    bus.begin(0)
    with pytest.raises(DeviceError, match="supply undervoltage"):
        driver.read(0)


def waits_in_vain(connect: Connect, clock: Clock, status: int) -> CurrentServo:
    """A drive that shows ``status`` longer than arming may take."""
    bus, port = connect(servo())
    driver = wheel(bus)
    driver.open()
    driver.arm()
    feedback(port, status)
    cycle(driver, port, 0.0)
    clock.pass_by(3.1)
    feedback(port, status)
    bus.begin(0)
    return driver


def test_drive_not_enabled_in_time_names_missing_condition(connect: Connect, clock: Clock) -> None:
    driver = waits_in_vain(connect, clock, 0x0240)
    with pytest.raises(DeviceError, match=r"not enabled 3 s .*switch on dis") as caught:
        driver.read(0)
    assert "supply of its power stage" in (caught.value.hint or "")


def test_missing_bit_12_is_named_with_its_option(connect: Connect, clock: Clock) -> None:
    driver = waits_in_vain(connect, clock, 0x0237)
    with pytest.raises(DeviceError, match=r"\(statusword 0x0237\), and bit 12, .* is 0") as caught:
        driver.read(0)
    assert "`follows_bit: false`" in (caught.value.hint or "")


def test_drive_without_bit_12_can_be_driven(connect: Connect) -> None:
    bus, port = connect(servo())
    driver = wheel(bus, follows_bit=False)
    driver.open()
    driver.arm()
    for status in (OFF, 0x0231, 0x0233, 0x0237):
        feedback(port, status)
        cycle(driver, port, 0.0)
    assert driver.ready()
    feedback(port, 0x0037)  # the maker's tool has it
    bus.begin(0)
    with pytest.raises(DeviceError, match="bit 12 or 9"):
        driver.read(0)


def test_belt_moves_holds_and_releases(connect: Connect) -> None:
    bus, port = connect(servo(2, mode=9))
    driver = belt(bus)
    driver.open()
    driver.arm()
    for status in (OFF, 0x0231, 0x0233, ENABLED):
        port.say(0x182, number(status, 2) + bytes(6))
        port.say(0x282, bytes(4))
        sent = cycle(driver, port, 0.5, 0.0)
    assert driver.ready()
    # 0.5 m/s over 100 mm/rev is 5 rev/s, 300 000 thousandths of a revolution per minute.
    assert sent == [
        (0x302, "00 00 01 00"),  # the clutch lets go, once the drive is enabled
        (0x202, "0f 00 e0 93 04 00"),
        (0x080, ""),
    ]
    # 100 mm: one revolution; -0.5 m/s; 1000 per mille of 44.25 mN m at 100 mm/rev.
    port.say(0x182, number(ENABLED, 2) + number(1000, 2) + number(4096, 4))
    port.say(0x282, number(-300_000, 4))
    bus.begin(0)
    row = driver.read(0)
    assert row == pytest.approx((0.1, -0.5, 0.04425 * 2 * math.pi / 0.1, ENABLED))
    driver.write([0.5, 1.0])
    bus.end(0)
    assert (0x302, bytes(4)) in port.sent[-4:]
    port.say(0x182, number(ENABLED, 2) + bytes(6))
    bus.begin(0)
    assert driver.read(0) is None  # its second PDO is missing
    first = len(port.sent)
    driver.make_safe()
    sent = [(to, data.hex(" ")) for to, data in port.sent[first:]]
    assert sent == [(0x202, "00 00 00 00 00 00"), (0x302, "00 00 00 00"), (0x080, "")] * 2


def test_shaft_behind_inverted_gear_has_its_own_scale(connect: Connect) -> None:
    bus, port = connect(servo(2, mode=9))
    options = {
        "node": 2, "counts_per_revolution": "4096 count/rev", "speed_range": "20 rad/s",
        "gear_ratio": 25, "inverted": True,
    }  # fmt: skip
    driver = RotaryServo(RotaryServoConfig.model_validate(options), bus)
    driver.open()
    driver.arm()
    for status in (OFF, 0x0231, 0x0233, ENABLED):
        port.say(0x182, number(status, 2) + bytes(6))
        port.say(0x282, bytes(4))
        bus.begin(0)
        driver.read(0)
        driver.write([2 * math.pi])
        bus.end(0)
    # 1 rev/s of the shaft is 25 rev/s of the motor: 1 500 000 thousandths of a rev/min.
    assert (0x202, number(0x0F, 2) + number(-1_500_000, 4)) in port.sent[-3:]
    # 1000 per mille of 44.25 mN m, times 25.
    port.say(0x182, number(ENABLED, 2) + number(1000, 2) + number(-25 * 4096, 4))
    port.say(0x282, number(-1_500_000, 4))
    bus.begin(0)
    row = driver.read(0)
    assert row == pytest.approx((2 * math.pi, 2 * math.pi, -1.10625, ENABLED))
    driver.make_safe()
    assert (0x202, bytes(6)) in port.sent[-2:]
    plain = RotaryServo.declare(RotaryServoConfig.model_validate({**options, "torque": False}))
    assert [channel.name for channel in plain.channels] == ["angle", "speed"]


def test_clutch_state_is_in_the_status(connect: Connect) -> None:
    bus, port = connect(servo(2, mode=9))
    driver = belt(bus)
    driver.open()
    port.say(0x182, number(OFF, 2) + bytes(6))
    port.say(0x282, bytes(4))
    bus.begin(0)
    row = driver.read(0)
    assert row is not None
    assert row[3] == OFF | CLUTCH_ENGAGED


def test_velocity_unit_decodes_object_60a9() -> None:
    # CiA 402-2, object 60A9h: prefix, numerator, denominator; FDh is 10^-3, B4h revolutions.
    assert velocity_unit(0x00B44700) == pytest.approx(2 * math.pi / 60)
    assert velocity_unit(0xFDB44700) == pytest.approx(2 * math.pi / 60e3)
    assert velocity_unit(0x00B40300) == pytest.approx(2 * math.pi)
    assert velocity_unit(0x00010300) is None  # m/s


def test_encoder_begins_at_zero_and_passes_counter_end(connect: Connect) -> None:
    bus, port = connect(scripted_encoder())
    driver = encoder(bus, gear_ratio=2.0)
    driver.open()
    rows = []
    for counts in (100, 0, (1 << 24) - 1, 100 + 4096):
        port.say(0x18B, number(counts, 4))
        bus.begin(0)
        rows.append(driver.read(0))
        bus.end(0)
    assert rows == [
        pytest.approx((0.0, 100, 5)),
        pytest.approx((-100 * math.pi / 4096, 0, 5)),
        pytest.approx((-101 * math.pi / 4096, -1, 5)),
        pytest.approx((math.pi, 4196, 5)),
    ]


def test_encoder_may_keep_its_own_zero_and_direction(connect: Connect) -> None:
    bus, port = connect(scripted_encoder())
    driver = encoder(
        bus, kind="linear", distance_per_count="10 um/count", zero="40 count", inverted=True
    )
    driver.open()
    port.say(0x18B, number(100, 4))
    bus.begin(0)
    assert driver.read(0) == pytest.approx((-0.6e-3, 100, 5))
    bus.end(0)
    bus.begin(0)
    assert driver.read(0) is None
    bus.end(0)
    port.say(0x18B, number(1 << 24, 4))
    bus.begin(0)
    with pytest.raises(ProtocolError, match="beyond its range"):
        driver.read(0)
