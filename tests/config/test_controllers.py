"""Controllers in a rig file: what they become, and every way to get one wrong."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from rigd.computed.controllers.driver import ControllerConfig
from rigd.config.checks.following import unsupervised
from rigd.config.loader import channel_names, parse_rig
from rigd.daemon.manual.choice import only
from rigd.model import ConfigError
from rigd.model.units import parse_quantity
from rigd.sdk.shipped_files import shipped_folder

FILE = Path("rig.yaml")
DERIVED = """\
derived:
  rim.speed: {is: derivative(wheel_encoder.angle) * rig.wheel_radius, lowpass: 50 Hz}
  rim.error: {is: derivative(wheel_encoder.angle)}
  rim.scale: {is: "lookup(carriage.position, [-1 m, 2 m], [1, 2])"}
  rim.help: {is: rim.speed * 0.1 A s/m}
  rim.asked: {is: 2 * wheel_servo.current_setpoint}
"""
LIMITS = "limits: {low: -0.5 m/s, high: 0.5 m/s, rate: 1 m/s^2}"
GOOD = f"""\
controllers:
  rim_hold:
    measured: rim.speed
    output: wheel_servo.current
    kp: 1 A s/m
    ki: 10 A/m
    kd: 0.01 A s^2/m
    filter: 30 Hz
    setpoint_weight: 0.5
    output_limits: [-1 A, 1.2 A]
    feed_forward: rim.help
    schedule: rim.scale
    {LIMITS}
  place_hold:
    {{measured: carriage.position, output: rim_hold, kp: 2 1/s, output_limits: [-0.1 m/s, 0.1 m/s],
     limits: {{low: 0 m, high: 1 m}}}}
"""


def with_controllers(rig_text: str, controllers: str) -> str:
    return rig_text.replace("interlocks:\n", f"{DERIVED}\n{controllers}\ninterlocks:\n", 1)


def test_setpoint_of_controller_rests_where_file_says(rig_text: str) -> None:
    for given, rest in (("", 0.0), (", rest: 0.2 m/s", 0.2)):
        text = GOOD.replace("rate: 1 m/s^2}", f"rate: 1 m/s^2{given}}}")
        rig = parse_rig(with_controllers(rig_text, text), FILE)
        assert rig.devices["rim_hold"].limits["speed"].rest == rest


def test_controllers_become_devices_with_a_setpoint(rig_text: str) -> None:
    rig = parse_rig(with_controllers(rig_text, GOOD), FILE)
    config = rig.devices["rim_hold"].config
    assert isinstance(config, ControllerConfig)
    assert (config.kp, config.ki, config.kd, config.low) == (1.0, 10.0, 0.01, -1.0)
    assert config.filter_s == pytest.approx(1 / (2 * 3.141592653589793 * 30))
    assert rig.devices["rim_hold"].limits["speed"].rate == 1.0
    assert rig.loops == {
        "place_hold.position": "rim_hold.speed", "rim_hold.speed": "wheel_servo.current",
    }  # fmt: skip
    units = {name: channel.unit for name in channel_names(rig) if (channel := rig.channel(name))}
    assert units["rim_hold.error"] == "m/s"
    assert units["rim_hold.integral"] == "A"
    assert units["place_hold.output"] == "m/s"
    assert not rig.devices["rim_hold"].is_actuator
    assert "rim_hold" in rig.settable


def test_setpoint_of_controller_needs_no_following_interlock(rig_text: str) -> None:
    assert unsupervised(parse_rig(with_controllers(rig_text, GOOD), FILE)) == []


def test_controller_passes_between_processes(rig_text: str) -> None:
    config = parse_rig(with_controllers(rig_text, GOOD), FILE).devices["rim_hold"].config
    assert pickle.loads(pickle.dumps(config)) == config


def test_part_of_rig_keeps_what_controller_needs(rig_text: str) -> None:
    rig = parse_rig(with_controllers(rig_text, GOOD), FILE)
    part = only(rig, {"place_hold"})
    assert {"carriage", "rim_hold", "rim", "wheel_encoder", "wheel_servo"} <= set(part.devices)
    assert "rim_hold" not in only(rig, {"carriage"}).devices


def test_product_in_parentheses_divides_unit() -> None:

    given, same = parse_quantity("0.1 A/(N s)"), parse_quantity("0.1 A/N/s")
    assert (given.value, given.unit.dimension) == (same.value, same.unit.dimension)


RIM = f"measured: rim.speed, output: wheel_servo.current, {LIMITS}"


@pytest.mark.parametrize(
    ("controllers", "token", "part"),
    [
        (f"a: {{{RIM}, kp: 1 A/N}}", "1 A/N", "is in A/N, expected A s/m"),
        (f"a: {{{RIM}, kp: 1}}", "1}", "has no unit: write '1 A s/m'"),
        (f"a: {{{RIM}, ki: 1 A s/m}}", "1 A s/m", "expected A/m"),
        (f"a: {{{RIM}, kd: 1 A s/m, filter: 9 Hz}}", "1 A s/m,", "expected A s^2/m"),
        (f"a: {{{RIM}}}", "{measured", "has no gain"),
        (f"a: {{{RIM}, kp: 1 A s/m, ki: -1 A/m}}", "{measured", "different signs"),
        (f"a: {{{RIM}, kp: 1 A s/m, kd: 1 A s^2/m}}", "1 A s^2", "'filter' is missing"),
        (f"a: {{{RIM}, kp: 1 A s/m, filter: 9 Hz}}", "filter", "that of the derivative"),
        (f"a: {{{RIM}, kp: 1 A s/m, kd: 1 A s^2/m, filter: 900 Hz}}", "900", "too fast"),
        (f"a: {{{RIM}, relay: 0.4 A, kp: 1 A s/m, hysteresis: 1 mm/s}}", "1 A s/m", "no effect"),
        (f"a: {{{RIM}, relay: 0.4 A}}", "0.4 A", "'hysteresis' is missing"),
        (f"a: {{{RIM}, relay: 0.4 N, hysteresis: 1 mm/s}}", "0.4 N", "expected A"),
        (f"a: {{{RIM}, relay: 0 A, hysteresis: 1 mm/s}}", "0 A", "does not move"),
        (f"a: {{{RIM}, relay: -1.7 A, hysteresis: 1 mm/s}}", "-1.7", "by 3.4 A between"),
        (f"a: {{{RIM}, relay: 0.4 A, hysteresis: -1 mm/s}}", "-1 mm", "is below 0"),
        (f"a: {{{RIM}, kp: 1 A s/m, hysteresis: 1 mm/s}}", "1 mm/s", "that of a relay"),
        (f"a: {{{RIM}, kp: 1 A s/m, output_limits: [0 A, 3 A]}}", "3 A", "is above 1.6 A"),
        (f"a: {{{RIM}, kp: 1 A s/m, output_limits: [1 A, 0 A]}}", "[1 A", "is not below"),
        (f"a: {{{RIM}, kp: 1 A s/m, feed_forward: rim.scale}}", "rim.scale", "expected A"),
        (f"a: {{{RIM}, kp: 1 A s/m, schedule: rim.speed}}", "rim.speed}", "expected 1"),
        (f"a: {{{RIM}, kp: 1 A s/m, schedule: rim.sped}}", "rim.sped}", "'rim.speed'?"),
        (f"a: {{{RIM}, kp: 1 A s/m, stale_after: 1 ms}}", "1 ms", "too short"),
        (f"a: {{{RIM}, kp: 1 A s/m}}".replace("rate: 1 m/s^2", "rest: 0.6 m/s"), "0.6 m/s",
         "0.6 m/s is above 0.5 m/s"),
        (f"a: {{{RIM}, kp: 1 A s/m}}".replace("rate: 1 m/s^2", "rest: 3 N"), "3 N", "expected m/s"),
        ("a: {measured: rim.speed, output: wheel_servo.current, kp: 1 A s/m}", "{measured",
         "has no limits, and rim.speed no range"),
        (f"a: {{measured: rim.sped, output: wheel_servo.current, {LIMITS}}}", "rim.sped", "rim.sp"),
        (f"a: {{measured: rim.speed, output: wheel_encoder.angle, {LIMITS}}}", "wheel_encoder",
         "is measured, not commanded"),
        ("a: {measured: rim.asked, output: wheel_servo.current, ki: 1 1/s, "
         "limits: {low: 0 A, high: 1 A}}",
         "rim.asked", "from no measured channel"),
        ("a: {measured: rim.error, output: wheel_servo.current, kp: 1 A s/rad, "
         "limits: {low: 0 rad/s, high: 1 rad/s}}", "rim.error", "a channel 'error' of its own"),
        (f"carriage: {{{RIM}, kp: 1 A s/m}}", "carriage", "is a device of this rig"),
        (f"rim: {{{RIM}, kp: 1 A s/m}}", "rim:", "is a device of this rig"),
        (f"a: {{{RIM}, kp: 1 A s/m}}\n  b: {{{RIM}, ki: 1 A/m}}", "", "commanded by a already"),
        (f"a: {{{RIM}, kp: 1 A s/m}}\n  b: {{measured: a.error, output: a, kp: 1, {LIMITS}}}",
         "a.error", "computed by a controller, not measured"),
        (f"a: {{measured: rim.speed, output: b, kp: 1, {LIMITS}}}\n  "
         f"b: {{measured: rim.speed, output: a, kp: 1, {LIMITS}}}", "b, kp", "a commands b"),
        (f"a: {{measured: rim.speed, output: a, kp: 1, {LIMITS}}}", "a, kp", "a commands a"),
        (f"a: {{measured: rim.speed, output: b.speed, kp: 1, {LIMITS}}}\n  "
         f"b: {{{RIM}, kp: 1 A s/m}}", "b.speed", "write 'output: b'"),
        (f"a: {{{RIM}, kp: 1 A s/m, setpoint_weight: 7}}", "7}", "at most 1"),
        (f"a: {{{RIM}, gain: 1 A s/m}}", "gain", "unknown key 'gain'"),
    ],
)  # fmt: skip
def test_wrong_controller_names_its_place(
    rig_text: str, controllers: str, token: str, part: str
) -> None:
    text = with_controllers(rig_text, f"controllers:\n  {controllers}\n")
    with pytest.raises(ConfigError) as caught:
        parse_rig(text, FILE)
    errors = [caught.value, *caught.value.others]
    assert part in str(caught.value), [str(error) for error in errors]
    assert len(errors) == 1, [str(error) for error in errors]
    place = caught.value.place
    assert place is not None
    if token:
        at = text.index(f"controllers:\n  {controllers}") + len("controllers:\n  ")
        at += controllers.index(token)
        assert place.line == text[:at].count("\n") + 1
        assert place.column == at - text[:at].rfind("\n")


@pytest.mark.parametrize("measured", ["scale.mass", "load.mean"])
def test_slow_device_needs_a_stated_stale_after(measured: str) -> None:
    path = shipped_folder("configs") / "wire_lugre.yaml"
    added = f"""\
derived:
  load.mean: {{is: (scale.mass + 1 kg) / 2}}
controllers:
  load_hold: {{measured: {measured}, output: wheel_servo.current, ki: 0.1 A/kg/s,
    limits: {{low: 0 kg, high: 5 kg}}}}
"""
    text = path.read_text().replace("interlocks:\n", f"{added}\ninterlocks:\n", 1)
    with pytest.raises(ConfigError, match=f"{measured} is from scale, whose readings come at a"):
        parse_rig(text, path)
    stated = text.replace("high: 5 kg}", "high: 5 kg}, stale_after: 1 s")
    assert "load_hold" in parse_rig(stated, path).devices
