"""The analogue speed drive against a simulated card: speed, clutch, position."""

from __future__ import annotations

import math
from typing import Any

import pytest
from support.cards.card import BenchMf624, Terminals

from rigd.sdk import DeviceError, LinkError
from rigd_drivers.cards.analog_speed_servo import AnalogSpeedServo, AnalogSpeedServoConfig

OPTIONS: dict[str, Any] = {
    "set_output": 1,
    "set_scale": "0.25 m/s/V",
    "speed_range": "2.5 m/s",
    "monitor_input": 2,
    "monitor_scale": "0.5 m/s/V",
    "encoder": 2,
    "distance_per_count": "10 um/count",
    "enable_output": 1,
    "clutch_output": 2,
}
ENABLE, CLUTCH = 1 << 1, 1 << 2
LSB = 20 / 0x4000


class Rig:
    """A belt drive on a card, opened, its terminals in the test's hand."""

    def __init__(self, *, link: dict[str, Any] | None = None, **options: Any) -> None:
        self.terminals = Terminals(counts=[0, 0, 5000, 0])
        self.link = BenchMf624(self.terminals.card(), **(link or {}))
        config = AnalogSpeedServoConfig.model_validate(OPTIONS | options)
        self.belt = AnalogSpeedServo(config, self.link)
        self.link.open()
        self.belt.open()

    def cycle(self, *setpoints: float) -> tuple[float, ...]:
        self.link.begin(0)
        row = self.belt.read(0)
        self.belt.write(setpoints)
        self.link.end(0)
        return tuple(row)

    @property
    def lines(self) -> int:
        return self.terminals.lines_out & (ENABLE | CLUTCH)


def test_a_row_is_position_counts_speed_and_volts() -> None:
    rig = Rig(encoder_inverted=True)
    rig.terminals.volts_in[2] = 1.0
    rig.terminals.counts[2] = 5003
    position, counts, speed, volts, _ = rig.cycle(0.0, 1.0)
    assert position == pytest.approx(-30e-6)
    assert counts == 3.0
    assert speed == pytest.approx(0.5, abs=0.5 * LSB)
    assert volts == pytest.approx(1.0, abs=LSB)
    assert len(rig.belt.declaration.channels) == 4


def test_speed_and_clutch_once_it_is_armed() -> None:
    rig = Rig()
    rig.cycle(0.5, 0.0)
    assert rig.lines == 0
    rig.belt.arm()
    rig.cycle(0.5, 1.0)
    assert rig.terminals.volts_out[1] == pytest.approx(2.0, abs=LSB)
    assert rig.lines == ENABLE
    rig.cycle(-9.0, 0.0)
    assert (rig.terminals.volts_out[1], rig.lines) == (-10.0, ENABLE | CLUTCH)


def test_safe_belt_stands_with_clutch_engaged() -> None:
    rig = Rig(link={"high_at_rest": [2]})
    rig.belt.arm()
    rig.cycle(0.5, 0.0)
    assert rig.lines == ENABLE, "this clutch is released by a low line"
    rig.belt.make_safe()
    assert (rig.terminals.volts_out[1], rig.lines) == (0.0, CLUTCH)
    rig.cycle(0.5, 0.0)
    assert (rig.terminals.volts_out[1], rig.lines) == (0.0, CLUTCH)


@pytest.mark.parametrize(
    ("setpoints", "name"), [((math.nan, 1.0), "speed"), ((-0.5, math.nan), "engaged")]
)
def test_nan_setpoint_is_refused_and_earlier_ones_hold(
    setpoints: tuple[float, float], name: str
) -> None:
    rig = Rig()
    rig.belt.arm()
    rig.cycle(0.5, 0.0)
    with pytest.raises(DeviceError, match=f"'{name}' is NaN"):
        rig.belt.write(setpoints)
    rig.link.end(0)
    assert rig.terminals.volts_out[1] == pytest.approx(2.0, abs=LSB)
    assert rig.lines == ENABLE | CLUTCH


def test_without_a_clutch_there_is_one_setpoint() -> None:
    rig = Rig(clutch_output=None)
    assert [setpoint.name for setpoint in rig.belt.declaration.setpoints] == ["speed"]
    rig.belt.arm()
    rig.cycle(0.5)
    assert rig.lines == ENABLE


def test_an_axis_that_jumps_has_lost_its_position() -> None:
    rig = Rig(fastest="1000 count/s")
    rig.terminals.counts[2] += 1_000_000
    with pytest.raises(DeviceError, match="encoder 2 jumped by 1000000 counts"):
        rig.cycle(0.0, 1.0)


def test_clutch_and_enable_are_two_lines() -> None:
    with pytest.raises(LinkError, match="digital output 1 is used twice"):
        Rig(clutch_output=1)


def test_range_above_10_v_is_refused() -> None:
    with pytest.raises(ValueError, match="'speed_range' needs 12 V"):
        AnalogSpeedServoConfig.model_validate(OPTIONS | {"speed_range": "3 m/s"})
