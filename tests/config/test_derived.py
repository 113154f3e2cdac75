"""Derived channels in a rig file: what they become, and every way to get one wrong."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from rigd.computed.derived.driver import DerivedConfig
from rigd.config.checks.following import trip_without_value
from rigd.config.loader import channel_names, parse_rig
from rigd.engine.cycle.wiring import streams_of
from rigd.model import ConfigError

FILE = Path("rig.yaml")
GOOD = """\
derived:
  wheel.speed: {is: derivative(wheel_encoder.angle), lowpass: 50 Hz, doc: of the wheel}
  wheel.slip: {is: wheel.speed * rig.wheel_radius - cart.speed, unit: m/s}
  cart.speed: {is: derivative(carriage.position), where: longitudinal_belt.speed_setpoint > -1 m/s}
  work.done: {is: integral(wheel_servo.current_setpoint * cart.speed), reset: trial}
"""


def with_derived(rig_text: str, derived: str) -> str:
    return rig_text.replace("interlocks:\n", f"{derived}\ninterlocks:\n", 1)


def test_groups_become_streams_with_units(rig_text: str) -> None:
    rig = parse_rig(with_derived(rig_text, GOOD), FILE)
    units = {name: channel.unit for name in channel_names(rig) if (channel := rig.channel(name))}
    assert units["wheel.speed"] == "rad/s"
    assert units["wheel.slip"] == "m/s"
    assert units["work.done"] == "m A"
    assert [stream.name for stream in streams_of(rig)][-4:] == ["wheel", "cart", "work", "cycle"]
    speed = rig.channel("wheel.speed")
    assert speed is not None
    assert speed.doc == "of the wheel"
    config = rig.devices["wheel"].config
    assert isinstance(config, DerivedConfig)
    assert config.devices == {"wheel_encoder", "carriage"}


def test_rig_with_derived_channels_passes_between_processes(rig_text: str) -> None:
    rig = parse_rig(with_derived(rig_text, GOOD), FILE)
    config = rig.devices["wheel"].config
    assert isinstance(config, DerivedConfig)
    again = pickle.loads(pickle.dumps(config))
    assert (again.graph.rows, again.graph.uses) == (config.graph.rows, config.graph.uses)


def test_wrong_formula_makes_no_right_channel_unknown(rig_text: str) -> None:
    wrong = GOOD.replace("rig.wheel_radius - cart.speed", "rig.wheel_radios - cart.speed")
    interlocks = (
        "interlocks:\n  - {name: runs, source: cart.speed, high: 2 m/s, action: stop, "
        "message: The cart runs.}\n"
        "  - {name: races, source: carriage.position, high: cart.speed, action: stop, "
        "message: The carriage runs.}\n"
    )
    text = with_derived(rig_text, wrong).replace("interlocks:\n", interlocks, 1)
    with pytest.raises(ConfigError) as caught:
        parse_rig(text, FILE)
    assert "wheel_radios" in str(caught.value)
    assert not caught.value.others


def test_interlock_may_watch_a_derived_channel(rig_text: str) -> None:
    interlock = (
        "interlocks:\n  - {name: slips, source: wheel.slip, high: 2 m/s, action: stop, "
        "message: The wheel slips.}\n"
    )
    text = with_derived(rig_text, GOOD).replace("interlocks:\n", interlock, 1)
    rig = parse_rig(text, FILE)
    assert rig.interlocks[0].source == "wheel.slip"


def test_arc_over_radius_is_an_angle_if_asked(rig_text: str) -> None:
    """As in a procedure: `${speed} / ${rig.wheel_radius}` can be a speed in rad/s."""
    derived = (
        "  a.turns: {is: derivative(carriage.position) / rig.wheel_radius, unit: rpm}\n"
        "  a.rim: {is: a.turns * rig.wheel_radius}\n"
        "  a.share: {is: derivative(carriage.position) / rig.wheel_radius}\n"
    )
    rig = parse_rig(with_derived(rig_text, f"derived:\n{derived}"), FILE)
    units = [rig.channel(f"a.{name}") for name in ("turns", "rim", "share")]
    assert [(item.unit, item.shown_in) for item in units if item] == [
        ("rad/s", "rpm"), ("m/s", "m/s"), ("1/s", "1/s"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("derived", "token", "part"),
    [
        ("a.b: {is: wheel_encoder.angel}", "wheel_encoder.angel", "'wheel_encoder.angle'?"),
        ("a.b: {is: 2 * carriage.position + 3 s}", "3 s", "cannot add s and m"),
        ("a.b: {is: carriage.position, unit: N}", "N}", "the formula gives m, not N"),
        ("a.b: {is: carriage.position, unit: furlong}", "furlong", "unknown unit"),
        ("a.b: {is: carriage.position, where: carriage.position}", "carriage.position}", "cond"),
        ("a.b: {is: carriage.position, lowpass: 900 Hz}", "900", "too fast"),
        ("a.b: {is: carriage.position, lowpass: 9 m}", "9 m", "expected 1/s"),
        ("a.b: {is: rig.weel_radius}", "rig.weel", "did you mean 'rig.wheel_radius'?"),
        ("a.b: {is: a.c + 1}\n  a.c: {is: a.d}\n  a.d: {is: 2 * a.b}", "a.b}", "uses a.c uses a.d"),
        ("a.b: {is: a.b}", "a.b}", "computed from itself"),
        ("carriage.b: {is: carriage.position}", "carriage.b", "is a device of this rig"),
        ("cycle.b: {is: carriage.position}", "cycle.b", "is taken"),
        ("ab: {is: carriage.position}", "ab:", "'ab'"),
        ("a.b: {is: carriage.position, reset: never}", "never", "run"),
        ("a.b: {is: carriage.position, formula: 2}", "formula", "unknown key 'formula'"),
        ("a.b: {is: max(carriage.position, 1 m)}", "1 m)", "quote a text that has a comma"),
        ("a.b: {is: a.c}\n  a.c: {is: carriage.speed}", "carriage.speed", "unknown channel"),
    ],
)
def test_wrong_derived_channel_names_its_place(
    rig_text: str, derived: str, token: str, part: str
) -> None:
    text = with_derived(rig_text, f"derived:\n  {derived}\n")
    with pytest.raises(ConfigError) as caught:
        parse_rig(text, FILE)
    errors = [caught.value, *caught.value.others]
    assert len(errors) == 1, [str(error) for error in errors]
    at = text.index(f"derived:\n  {derived}") + len("derived:\n  ") + derived.index(token)
    place = caught.value.place
    assert place is not None
    assert place.line == text[:at].count("\n") + 1
    if token not in ("ab:", "never"):
        assert place.column == at - text[:at].rfind("\n")
    assert part in str(caught.value)


@pytest.mark.parametrize(
    ("formula", "count"),
    [
        ("{is: carriage.position, where: carriage.position > 1 m}", 1),
        ('{is: "hold(carriage.position, carriage.position > 1 m)"}', 1),
        ('{is: "where(carriage.position > 1 m, carriage.position, 0 m)"}', 0),
    ],
)
def test_interlock_on_conditional_channel_is_named(rig_text: str, formula: str, count: int) -> None:
    interlock = (
        "interlocks:\n  - {name: far, source: far.way, high: 2 m, action: stop, message: Far.}\n"
    )
    text = rig_text.replace("interlocks:\n", f"derived:\n  far.way: {formula}\n{interlock}", 1)
    named = trip_without_value(parse_rig(text, FILE))
    assert len(named) == count
    assert all("interlock far trips wherever far.way has no value" in line for line in named)
