"""Rig files: what the shipped one becomes, and every way to get one wrong."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from support.engine.grid import PlantGrid

from rigd.config.loader import load_rig, parse_rig
from rigd.model import ConfigError
from rigd.model.constants import Constant, Uncertainty
from rigd.model.limits import Priority, SetpointLimit
from rigd.model.severity import Severity
from rigd.model.units import parse_unit

Spoil = Callable[[str, str], str]
FILE = Path("rig.yaml")


def place_of(text: str, token: str) -> str:
    head = text[: text.index(token)]
    return f"{head.count(chr(10)) + 1}:{len(head) - head.rfind(chr(10))}"


def test_shipped_lugre_rig_loads_with_expected_content(rig_path: Path) -> None:
    rig = load_rig("lugre-1")
    assert rig.name == "lugre-1"
    assert rig.period_ns == 1_000_000
    assert rig.plant is not None
    assert rig.plant.model == "lugre"
    servo = rig.devices["wheel_servo"]
    assert servo.limits == {"current": SetpointLimit(-1.6, 1.6, 2000.0, 0.0)}
    assert rig.devices["longitudinal_belt"].limits["engaged"].rest == 1.0
    channel = rig.channel("carriage.position")
    assert channel is not None
    assert channel.unit == "m"
    assert rig.setpoint("wheel_servo.current") is not None
    assert rig.channel("wheel_servo.nothing") is None
    near = next(interlock for interlock in rig.interlocks if interlock.name == "overrun_near")
    assert (near.low, near.high, near.action) == (-0.04, None, Severity.ABORT)
    assert near.priority is Priority.CRITICAL
    assert rig.constants["wheel_radius"].value == pytest.approx(0.05)
    assert rig.constants["wheel_radius"].u == Uncertainty(1e-4)
    assert rig.constants["guide_friction"].u == Uncertainty(0.05, is_share=True)
    assert rig.source.text == rig_path.read_text()


@pytest.mark.parametrize(
    ("name", "bound", "words"),
    [
        ("wheel.positon", "1 rad", "unknown channel 'wheel.positon'"),
        ("carriage.position", "1 A", "'1 A' is in A, expected m"),
        ("carriage.position", "0 m", "0 m must be more than 0"),
        ("carriage.position", "0 m/s", "0 m/s must be more than 0"),
    ],
)
def test_wrong_channel_at_rest_is_refused(
    rig_path: Path, name: str, bound: str, words: str
) -> None:
    text = f"supervision: {{at_rest: {{{name}: {bound}}}}}\n"
    wrong = re.sub(r"^supervision:.*\n", text, rig_path.read_text(), flags=re.MULTILINE)
    with pytest.raises(ConfigError, match=re.escape(words)) as caught:
        parse_rig(wrong, rig_path)
    assert place_of(wrong, name) in str(caught.value) or place_of(wrong, bound) in str(caught.value)


def test_every_actuator_has_limit_within_devices_own() -> None:
    for device in load_rig("lugre-1").devices.values():
        assert set(device.limits) == {setpoint.name for setpoint in device.setpoints}
        for setpoint in device.setpoints:
            limit = device.limits[setpoint.name]
            assert setpoint.low <= limit.low <= limit.rest <= limit.high <= setpoint.high


@pytest.mark.parametrize(
    ("old", "new", "token", "parts"),
    [
        ("cycle: 1 kHz", "cicle: 1 kHz", "cicle", ["unknown key 'cicle'", "did you mean 'cycle'"]),
        ("cycle: 1 kHz", "cycle: 1000", "1000", ["has no unit: write '1000 Hz'"]),
        ("cycle: 1 kHz", "cycle: 1 ms", "1 ms", ["'1 ms' is in ms, expected Hz"]),
        ("cycle: 1 kHz", "cycle: 50 Hz", "50 Hz", ["'50 Hz' must be at least 100 Hz"]),
        ("cycle: 1 kHz", "cycle: 9 kHz", "9 kHz", ["'9 kHz' must be at most 5000 Hz"]),
        ("cycle: 1 kHz", "cycle: 1 kHq", "1 kHq", ["unknown unit 'kHq'"]),
        ("cycle: 1 kHz", "cycle: 1 *", "1 *", ["cannot read '*' as a unit"]),
        ("cycle: 1 kHz", "cycle: 1 km^999", "1 km^999", ["the power in 'km^999' is larger than 9"]),
        ("cycle: 1 kHz", "cycle: 1e999 Hz", "1e999 Hz", ["too large a number"]),
        ("rig: lugre-1", "rig: Lugre 1", "Lugre 1",
         ["'Lugre 1' is not a valid name: small letters, digits, _ and -, a letter first"]),
        ("\nrig: lugre-1", "\nrig:", "rig:\n", ["expected text, found nothing"]),
        ("driver: sim-lugre-truth", "driver: sim-lugre-thruth", "sim-lugre-thruth",
         ["no driver 'sim-lugre-thruth' is installed", "did you mean 'sim-lugre-truth'"]),
        ("model: lugre", "model: lugree", "lugree", ["no plant 'lugree'", "'lugre'"]),
        ("floor: stone", "floor: ston", "ston\n", ["'ston' is not one of", "'stone'"]),
        ("floor: stone", "flor: stone", "flor", ["unknown key 'flor'", "did you mean 'floor'"]),
        ("{axis: wheel}", "{axis: weel}", "weel", ["'weel' is not one of wheel, carriage"]),
        ("{axis: wheel}", "{axes: wheel}", "axes", ["unknown key 'axes'", "'axis'"]),
        ("low: -1.6 A, high: 1.6 A", "low: -1.6 V, high: 1.6 A", "-1.6 V",
         ["'-1.6 V' is in V, expected A"]),
        ("low: -1.6 A, high: 1.6 A", "low: -1.6 A, high: 2.6 A", "2.6 A",
         ["2.6 A is above 2 A", "the device's own current"]),
        ("low: -1.6 A, high: 1.6 A", "low: 1.7 A, high: 1.6 A", "1.7 A", ["is above high 1.6 A"]),
        ("rate: 2000 A/s", "rate: 2000 A", "2000 A}", ["'2000 A' is in A, expected A/s"]),
        ("rate: 2000 A/s", "rate: 0 A/s", "0 A/s}", ["must be above 0"]),
        (", rate: 2000 A/s", "", "{low: -1.6", ["key 'rate' is missing"]),
        ("      current: {low", "      curent: {low", "curent",
         ["wheel_servo has no setpoint 'curent'", "did you mean 'current'"]),
        ("    limits:\n      current: {low: -1.6 A, high: 1.6 A, rate: 2000 A/s}\n", "",
         "driver: sim-lugre-amplifier", ["takes the setpoint 'current', but has no limit"]),
        ("source: wheel_encoder.angle", "source: wheel_encoder.angel", "wheel_encoder.angel",
         ["unknown channel 'wheel_encoder.angel'", "'wheel_encoder.angle'"]),
        ("low: -1.8 A\n    high: 1.8 A", "low: 1.8 A\n    high: -1.8 A", "1.8 A\n    high: -1.8",
         ["low 1.8 A is not below high -1.8 A"]),
        ("high: 1.65 m", "high: 1.65 mm/s", "1.65 mm/s", ["is in mm/s, expected m"]),
        ("high: 1.65 m", "high: wheel_servo.current", "wheel_servo.current\n",
         ["wheel_servo.current is in A, expected m"]),
        ("high: 1.65 m", "high: carriage.positon", "carriage.positon", ["'carriage.position'"]),
        ("high: 1.65 m", "high: 3 m", "3 m",
         ["3 m is above 1.8 m", "what the channel can measure"]),
        ("delay: 20 ms", "delay: -20 ms", "-20 ms", ["'-20 ms' must be at least 0 s"]),
        ("deadband: 0.1 A", "deadband: 1.9 A", "1.9 A\n",
         ["the deadband 1.9 A is more than half of the range from -1.8 A to 1.8 A"]),
        ("while: longitudinal_belt.engaged", "while: longitudinal_belt.speed",
         "longitudinal_belt.speed #", ["is in m/s, and 'while' needs a switch, 0 or 1"]),
        ("deadband: 0.1 A", "deadband: 0.1 m", "0.1 m\n", ["'0.1 m' is in m, expected A"]),
        ("name: over_current", "name: overrun_far", "overrun_far\n    source: wheel",
         ["interlock name 'overrun_far' is used twice"]),
        ("gravity: {value: 9.81 m/s^2", "gravity: {value: fast", "fast, u", ["cannot read 'fast'"]),
        ("50 mm, u: 0.1 mm", "50 mm, u: 0.1 kg", "0.1 kg",
         ["'0.1 kg' is in kg, expected mm or %", "'0.1 mm' or '0.2 %'"]),
        ("50 mm, u: 0.1 mm", "50 mm, u: 0.1", "0.1, s", ["has no unit: write '0.1 mm'"]),
        ("50 mm, u: 0.1 mm", "50 mm, u: -0.1 mm", "-0.1 mm", ["'-0.1 mm' is below 0", "(k = 1)"]),
        ("50 mm, u: 0.1 mm", "50 mm, u: some", "some", ["cannot read 'some'"]),
        ("value: 50 mm, u: 0.1 mm", "u: 0.1 mm", "{u: 0.1 mm", ["key 'value' is missing"]),
        ("50 mm, u: 0.1 mm", "50 mm, sd: 0.1 mm", "sd:", ["unknown key 'sd'", "source, u, value"]),
        ("{value: 50 mm, u: 0.1 mm", "{value: [50 mm], u: 0.1 mm", "[50 mm]", ["expected text"]),
        ("interlocks:\n", "interlocks: 1\nx:\n", "1\nx:", ["expected a list, found '1'"]),
        ("{axis: wheel}", "[axis, wheel]", "[axis", ["expected a mapping", "a list of 2"]),
        ("constants:", "constant:", "constant:", ["unknown key 'constant'", "'constants'"]),
    ],
)  # fmt: skip
def test_problem_is_reported_at_its_place_in_file(
    spoil: Spoil, old: str, new: str, token: str, parts: list[str]
) -> None:
    text = spoil(old, new)
    with pytest.raises(ConfigError) as caught:
        parse_rig(text, FILE)
    shown = str(caught.value)
    assert f"rig.yaml:{place_of(text, token)}: " in shown
    for part in parts:
        assert part in shown


def test_choices_are_listed_once(rig_text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_rig(rig_text.replace("action: abort", "action: halt", 1), FILE)
    assert "'halt' is not one of warn, end_trial" in str(caught.value)
    assert str(caught.value).count("end_trial") == 1


def test_all_problems_are_reported_in_order_of_file(rig_text: str) -> None:
    text = (
        rig_text.replace("cycle: 1 kHz", "cycle: 1 s")
        .replace("action: abort", "action: abrot")
        .replace("title:", "titel:")
    )
    with pytest.raises(ConfigError) as caught:
        parse_rig(text, FILE)
    errors = [caught.value, *caught.value.others]
    assert len(errors) == 3 + text.count("abrot")  # title missing, titel unknown, cycle
    lines = [error.place.line for error in errors if error.place is not None]
    assert lines == sorted(lines)
    assert len(lines) == len(errors)


def test_bad_options_of_two_devices_are_reported_together(rig_text: str) -> None:
    text = rig_text.replace("axis: wheel", "axis: x").replace("axis: lateral", "axis: y")
    with pytest.raises(ConfigError) as caught:
        parse_rig(text, FILE)
    assert len(caught.value.others) == 1


def test_procedure_is_no_rig_file() -> None:
    with pytest.raises(ConfigError, match=r":2:1: this is a procedure file") as caught:
        parse_rig("title: Pull\nprocedure: pull\ndoc: Pulls.\ntrial: {steps: []}\n", FILE)
    assert "--rig" in (caught.value.hint or "")
    assert not caught.value.others


DRIVE = """\
rig: bench
title: Bench
cycle: 200 Hz
interlocks: []
devices:
  drive:
    driver: modbus-servo
    options:
      host: 192.168.1.20
      map: schneider-atv320
      max_speed: 60 rad/s
      watchdog: 0.55 s
    limits: {speed: {low: 0 rad/s, high: 40 rad/s, rate: 40 rad/s^2}}
"""


def test_check_of_several_keys_names_its_line() -> None:
    with pytest.raises(ConfigError, match=r":12:17: 'watchdog' of 0\.55 s must be a multiple"):
        parse_rig(DRIVE, FILE)


def test_missing_space_after_colon_is_named() -> None:
    text = DRIVE.replace("0.55 s", "0.5 s").replace("low: 0", "low:0")
    with pytest.raises(ConfigError) as caught:
        parse_rig(text, FILE)
    assert "write 'low: 0 rad/s', with a space after the colon" in str(caught.value)


def test_cycle_silence_below_first_report_is_refused(spoil: Spoil) -> None:
    text = spoil("cycle: 1 kHz", "cycle: 100 Hz").replace(
        "cycle_silence: 250 ms", "cycle_silence: 25 ms"
    )
    with pytest.raises(ConfigError, match=r"cycle_silence 0\.025 s"):
        parse_rig(text, FILE)
    parse_rig(text.replace("25 ms", "30 ms"), FILE)


def test_stale_after_below_two_cycles_is_refused(spoil: Spoil) -> None:
    text = spoil("cycle: 1 kHz", "cycle: 100 Hz").replace(
        "stale_after: 20 ms", "stale_after: 15 ms"
    )
    with pytest.raises(ConfigError, match="less than two cycles"):
        parse_rig(text, FILE)


SOONER = """\
rig: bench
title: Bench
cycle: 1 kHz
plant: {model: approach-angle}
devices: {daq: {driver: sim-angle-daq, options: OPTIONS}}
interlocks:
  - {name: far, source: daq.wheel_angle, high: 50 rad, action: stop, message: Look,
     stale_after: 40 ms}
"""


@pytest.mark.parametrize(
    ("options", "oldest", "least"),
    [("{}", "45.1 ms", "47 ms"), ("{block: 960}", "135.1 ms", "137 ms")],
)
def test_staleness_sooner_than_blocks_come_is_refused(
    options: str, oldest: str, least: str
) -> None:
    text = SOONER.replace("OPTIONS", options)
    with pytest.raises(ConfigError) as error:
        parse_rig(text, FILE)
    assert "too short for daq" in error.value.message
    assert oldest in error.value.message
    assert least in (error.value.hint or "")
    parse_rig(text.replace("40 ms", least), FILE)


def test_block_device_on_a_plant_needs_a_plant(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigd.config.loader.find_driver", lambda name: PlantGrid)
    text = (
        "rig: bench\ntitle: Bench\ncycle: 1 kHz\ndevices: {grid: {driver: grid}}\ninterlocks: []\n"
    )
    with pytest.raises(ConfigError, match=r"grid .*plant"):
        parse_rig(text, FILE)
    assert parse_rig(f"{text}plant: {{model: lugre}}\n", FILE).devices["grid"].stream.has_status


def test_options_of_wrong_axis_are_refused_by_driver(spoil: Spoil) -> None:
    text = spoil("{axis: wheel}", "{axis: wheel, distance_per_count: 1 mm/count}")
    with pytest.raises(ConfigError, match="belongs to 'axis: carriage'"):
        parse_rig(text, FILE)


@pytest.mark.parametrize(
    ("written", "u", "source"),
    [
        ("50 mm", None, ""),
        ("{value: 50 mm}", None, ""),
        ("{value: 50 mm, u: 0.2 mm, source: data sheet}", Uncertainty(2e-4), "data sheet"),
        ("{value: 50 mm, u: 0 mm}", Uncertainty(0.0), ""),
        ("{value: 50 mm, u: 2 %}", Uncertainty(0.02, is_share=True), ""),
    ],
)
def test_constant_is_read_in_every_written_form(
    rig_text: str, written: str, u: Uncertainty | None, source: str
) -> None:
    text = f"{rig_text.partition('constants:')[0]}constants:\n  radius: {written}\n"
    assert parse_rig(text, FILE).constants["radius"] == Constant(0.05, parse_unit("mm"), u, source)


def test_only_slow_devices_may_hold_at_stop(rig_path: Path) -> None:
    text = rig_path.read_text().replace(
        "high: 1.6 A, rate: 2000 A/s}", "high: 1.6 A, rate: 2000 A/s, at_stop: hold}"
    )
    with pytest.raises(ConfigError) as caught:
        parse_rig(text, FILE)
    assert f"rig.yaml:{place_of(text, 'hold}')}" in str(caught.value)
    assert "wheel_servo is no slow device: a stop must take current to rest" in str(caught.value)
    oven = load_rig("oven-1").devices["oven"].limits["temperature"]
    assert oven.holds
    assert oven.rest == pytest.approx(293.15)
