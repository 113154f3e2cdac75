"""The analogue amplifier against a simulated card: signs, scales, enable, ready, watchdog."""

from __future__ import annotations

import math
import time
from typing import Any

import pytest
from support.cards.card import BenchMf624, Terminals

from rigd.sdk import DeviceError, LinkError
from rigd_drivers.cards.analog_drive import ENABLED, LIMITED, ONE_SHOT, READY, SATURATED
from rigd_drivers.cards.analog_servo import AnalogServo, AnalogServoConfig
from rigd_sim.wire.cards.analog_drives import OneShot

OPTIONS: dict[str, Any] = {
    "set_output": 2,
    "set_scale": "0.5 A/V",
    "current_range": "4 A",
    "monitor_input": 1,
    "monitor_scale": "2.5 A/V",
    "enable_output": 3,
    "ready_input": 4,
}
ONE_SHOT_OPTIONS: dict[str, Any] = {"output": 7, "time": "100 ms", "input": 7}
READY_LINE = 1 << 4
LSB = 20 / 0x4000


class Rig:
    """An amplifier on a card, opened, its terminals in the test's hand."""

    def __init__(self, *, link: dict[str, Any] | None = None, **options: Any) -> None:
        self.terminals = Terminals(lines_in=READY_LINE)
        self.card = self.terminals.card()
        self.link = BenchMf624(self.card, **(link or {}))
        config = AnalogServoConfig.model_validate(OPTIONS | options)
        self.servo = AnalogServo(config, self.link)
        self.link.open()
        self.servo.open()

    def cycle(self, current: float = 0.0) -> tuple[float, ...]:
        self.link.begin(0)
        row = self.servo.read(0)
        self.servo.write((current,))
        self.link.end(0)
        return tuple(row)

    def arm(self) -> None:
        self.servo.arm()
        for _ in range(2):
            self.cycle()
        assert self.servo.ready()

    @property
    def volts(self) -> float:
        return self.terminals.volts_out[2]

    @property
    def enable_line(self) -> bool:
        return bool(self.terminals.lines_out >> 3 & 1)


@pytest.mark.parametrize(
    ("inverted", "current", "volts"), [(False, 1.0, 2.0), (True, 1.0, -2.0), (False, -4.0, -8.0)]
)
def test_sign_and_scale_of_the_set_value(inverted: bool, current: float, volts: float) -> None:
    rig = Rig(set_inverted=inverted)
    rig.arm()
    rig.cycle(current)
    assert rig.volts == pytest.approx(volts, abs=LSB)


@pytest.mark.parametrize(
    ("inverted", "zero", "volts", "current"),
    [(True, "0 V", -0.4, 1.0), (False, "0 V", -0.4, -1.0), (True, "50 mV", -0.35, 1.0)],
)
def test_sign_scale_and_zero_of_the_monitor(
    inverted: bool, zero: str, volts: float, current: float
) -> None:
    rig = Rig(monitor_inverted=inverted, monitor_zero=zero)
    rig.terminals.volts_in[1] = volts
    found, raw, _ = rig.cycle()
    assert raw == pytest.approx(volts, abs=LSB)
    assert found == pytest.approx(current, abs=2.5 * LSB)


def test_nothing_is_commanded_or_enabled_before_arming() -> None:
    rig = Rig()
    rig.cycle(1.0)
    assert (rig.volts, rig.enable_line) == (0.0, False)
    rig.servo.arm()
    rig.cycle(1.0)
    assert rig.volts == pytest.approx(2.0, abs=LSB)
    assert rig.enable_line


@pytest.mark.parametrize(("active", "rest"), [("high", []), ("low", [3])])
def test_make_safe_gives_zero_volts_and_disables_immediately(active: str, rest: list[int]) -> None:
    rig = Rig(link={"high_at_rest": rest}, enable_active=active)
    assert rig.enable_line == (active == "low")
    rig.arm()
    rig.cycle(-2.0)
    assert rig.enable_line == (active == "high")
    for _ in range(2):
        rig.servo.make_safe()
        assert (rig.volts, rig.enable_line) == (0.0, active == "low")
    rig.cycle(1.0)
    assert (rig.volts, rig.enable_line) == (0.0, active == "low"), "and stays so"


def test_enable_line_active_at_rest_is_refused() -> None:
    with pytest.raises(LinkError, match="output 3 stands low at rest"):
        Rig(enable_active="low")
    with pytest.raises(LinkError, match="output 3 stands high at rest"):
        Rig(link={"high_at_rest": [3]})


def test_two_drives_never_share_an_output() -> None:
    rig = Rig()
    config = AnalogServoConfig.model_validate(OPTIONS | {"set_output": 0})
    second = AnalogServo(config, rig.link)
    with pytest.raises(LinkError, match=r"output 3 .*two devices"):
        second.open()
    rig.arm()
    second.make_safe()
    assert rig.enable_line, "one that never had an output leaves it alone"


def test_status_word_shows_state_of_drive() -> None:
    rig = Rig()
    assert rig.cycle(9.0)[-1] == READY | ONE_SHOT
    rig.servo.arm()
    assert rig.cycle(4.0)[-1] == ENABLED | LIMITED | READY | ONE_SHOT, "9 A were asked for before"
    assert rig.cycle()[-1] == ENABLED | READY | ONE_SHOT


@pytest.mark.parametrize(("volts", "saturated"), [(9.99, 0), (12.0, SATURATED), (-11, SATURATED)])
def test_a_monitor_at_a_rail_is_flagged(volts: float, saturated: int) -> None:
    rig = Rig()
    rig.terminals.volts_in[1] = volts
    assert int(rig.cycle()[-1]) & SATURATED == saturated


def test_setpoints_beyond_range_clip_and_nan_is_refused() -> None:
    rig = Rig()
    rig.arm()
    rig.cycle(math.inf)
    assert rig.volts == pytest.approx(8.0, abs=LSB)
    with pytest.raises(DeviceError, match="'current' is NaN; expected -4 to 4 A"):
        rig.servo.write((math.nan,))
    rig.link.end(0)
    assert rig.volts == pytest.approx(8.0, abs=LSB), "the one before it holds"


def test_range_above_10_v_is_refused() -> None:
    with pytest.raises(ValueError, match="'current_range' needs 12 V"):
        AnalogServoConfig.model_validate(OPTIONS | {"current_range": "6 A"})


def test_ready_input_reports_ready_and_its_loss_faults() -> None:
    rig = Rig(ready_active="low")
    rig.servo.arm()
    rig.cycle()
    assert not rig.servo.ready()
    rig.terminals.lines_in = 0
    rig.cycle()
    assert rig.servo.ready()
    rig.terminals.lines_in = READY_LINE
    with pytest.raises(DeviceError, match=r"not ready any more \(digital input 4\)"):
        rig.cycle()
    rig.servo.make_safe()
    assert not rig.servo.ready()


def test_preflight_names_unready_drive_and_monitor_at_rail() -> None:
    rig = Rig()
    assert rig.servo.preflight() == []
    rig.terminals.lines_in = 0
    rig.terminals.volts_in[1] = 12.0
    first, second = rig.servo.preflight()
    assert "not ready (digital input 4)" in first
    assert "10.00 V with the drive disabled (analogue input 1)" in second


def guarded(*, nominal_s: float = 0.05) -> tuple[Rig, OneShot]:
    """Return a rig whose enable line goes through a one-shot declared as one of 100 ms."""
    rig = Rig(link={"one_shot": ONE_SHOT_OPTIONS}, behind_one_shot=True)
    rig.terminals.one_shot = OneShot(nominal_s, time.monotonic_ns)
    return rig, rig.terminals.one_shot


def test_watchdog_is_that_of_card_or_none() -> None:
    assert Rig(link={"one_shot": ONE_SHOT_OPTIONS}).servo.watchdog_s is None
    assert guarded()[0].servo.watchdog_s == 0.1
    with pytest.raises(LinkError, match="has no 'one_shot'"):
        Rig(behind_one_shot=True)


def test_a_watchdog_is_proven_without_enabling_anything() -> None:
    rig, one_shot = guarded()
    assert rig.servo.prove_watchdog() > 0.045
    assert not one_shot.up
    assert not rig.enable_line


def test_a_watchdog_that_stays_up_is_found() -> None:
    rig, one_shot = guarded()
    one_shot.dead = True
    with pytest.raises(DeviceError, match=r"still up 0\.1\d* s .* most 0\.1 s"):
        rig.servo.prove_watchdog()


def test_a_watchdog_slower_than_declared_is_found() -> None:
    rig, _ = guarded(nominal_s=0.4)
    with pytest.raises(DeviceError, match="still up"):
        rig.servo.prove_watchdog()


def test_a_watchdog_that_never_comes_up_is_found() -> None:
    rig, _ = guarded(nominal_s=0.0)
    with pytest.raises(DeviceError, match=r"not come up .*output 7"):
        rig.servo.prove_watchdog()


def test_one_shot_makes_drive_ready_and_failed() -> None:
    rig, _ = guarded(nominal_s=30.0)
    rig.servo.arm()
    rig.link.sample()
    assert rig.servo.read(0)[-1] == ENABLED | READY
    assert not rig.servo.ready()
    rig.cycle()
    rig.cycle()
    assert rig.servo.ready()
    rig.terminals.one_shot = None
    with pytest.raises(DeviceError, match=r"one-shot dropped .* no edge for 0\.1 s"):
        rig.cycle()


def test_rescue_uses_another_connection() -> None:
    rig = Rig()
    rig.arm()
    rig.cycle(1.0)
    fresh = BenchMf624(rig.card)
    AnalogServo(AnalogServoConfig.model_validate(OPTIONS), fresh).rescue()
    assert fresh.alone == [False]
    assert (rig.volts, rig.enable_line) == (0.0, False)


def test_unopened_drive_is_made_safe_silently() -> None:
    config = AnalogServoConfig.model_validate(OPTIONS)
    servo = AnalogServo(config, BenchMf624(Terminals().card()))
    servo.make_safe()
    servo.close()


def test_range_of_channel_is_what_input_can_show() -> None:
    config = AnalogServoConfig.model_validate(OPTIONS | {"monitor_zero": "1 V"})
    current, raw = AnalogServo.declare(config).channels
    assert (current.name, current.low, current.high) == ("current", -22.5, 27.5)
    assert (raw.name, raw.low, raw.high, raw.raw_of) == ("current_raw", -10, 10, "current")
