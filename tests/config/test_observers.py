"""Observers in a rig file: what they become, and every way to get one wrong."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from rigd.computed.observers.driver import ObserverConfig
from rigd.config.loader import parse_rig
from rigd.daemon.manual.choice import only
from rigd.engine.cycle.wiring import streams_of
from rigd.model import ConfigError
from rigd.sdk.shipped_files import shipped_folder

FILE = Path("rig.yaml")
GOOD = """\
observers:
  cart:
    model: linear
    states: {position: m, speed: m/s, bias: m/s^2}
    inputs: [accelerometer.acceleration]
    measured: [carriage.position]
    a: [[0, 1, 0], [0, 0, -1], [0, 0, 0]]
    b: [[0], [1], [0]]
    c: [[1, 0, 0]]
    q: [0, 1e2 mm^2/s^3, 1e-8 m^2/s^5]
    r: [1e-10]
    x0: [20 mm, 0, 0]
    p0: [[1, 0, 0], [0, 1, 0], [0, 0, 1e-2]]
"""


def with_observers(rig_text: str, observers: str) -> str:
    return rig_text.replace("interlocks:\n", f"{observers}\ninterlocks:\n", 1)


def config_of(text: str) -> ObserverConfig:
    config = parse_rig(text, FILE).devices["cart"].config
    assert isinstance(config, ObserverConfig)
    return config


def test_states_become_a_stream_with_units(rig_text: str) -> None:
    rig = parse_rig(with_observers(rig_text, GOOD), FILE)
    stream = streams_of(rig)[-2]
    assert stream.name == "cart"
    assert [(channel.name, channel.unit) for channel in stream.channels] == [
        ("position", "m"), ("position_sd", "m"), ("speed", "m/s"), ("speed_sd", "m/s"),
        ("bias", "m/s^2"), ("bias_sd", "m/s^2"), ("carriage_position_innovation", "m"),
        ("nis", "1"),
    ]  # fmt: skip


def test_entries_are_converted_and_discretised(rig_text: str) -> None:
    config = config_of(with_observers(rig_text, GOOD))
    period = config.period_ns * 1e-9
    assert config.plan.x0 == (0.02, 0.0, 0.0)
    assert config.plan.f[0] == pytest.approx((1.0, period, -(period**2) / 2))
    assert config.plan.g[1] == pytest.approx((period,))
    assert config.plan.q[1][1] == pytest.approx(1e-4 * period)
    assert config.lost_ns == 1_000_000_000


def test_discrete_matrices_are_taken_as_they_are(rig_text: str) -> None:
    text = GOOD.replace("a: [[0, 1, 0], [0, 0, -1], [0, 0, 0]]", "a: [[1, 0.1 s, 0], [0, 0.9, 0],"
                        " [0, 1e-3 1/s, 0.5]]\n    time: discrete")  # fmt: skip
    text = text.replace("1e2 mm^2/s^3", "4 mm^2/s^2").replace("1e-8 m^2/s^5", "1e-8 m^2/s^4")
    config = config_of(with_observers(rig_text, text.replace("[[1, 0, 0]]", "[[1, 0, 1 s^2]]")))
    assert config.plan.f == ((1.0, 0.1, 0.0), (0.0, 0.9, 0.0), (0.0, 1e-3, 0.5))
    assert config.plan.q[1][1] == pytest.approx(4e-6)


WARM = (
    GOOD.replace("speed: m/s, bias: m/s^2", "gain: 1, heat: K").replace("1e-8 m^2/s^5", "1e-8")
    .replace("1e2 mm^2/s^3", "1").replace("[0, 0, -1]", "[0, -1, 0]")
    .replace("[0, 0, 0]]", "[0, 0, -1]]").replace("x0: [20 mm, 0, 0]", "x0: [0, 0, 20 degC]")
)  # fmt: skip


def test_temperature_begins_on_its_scale(rig_text: str) -> None:
    assert config_of(with_observers(rig_text, WARM)).plan.x0 == pytest.approx((0.0, 0.0, 293.15))


def test_temperature_as_factor_must_be_difference(rig_text: str) -> None:
    text = WARM.replace("[0, 1, 0], [0, 0, 1e-2]]", "[0, 1, 5 degC], [0, 5 K, 1e-2]]")
    with pytest.raises(ConfigError, match="a difference is expected here: write '5 K'"):
        parse_rig(with_observers(rig_text, text), FILE)


def test_rig_with_observer_passes_between_processes(rig_text: str) -> None:
    config = config_of(with_observers(rig_text, GOOD))
    assert pickle.loads(pickle.dumps(config)) == config


def test_derived_channel_keeps_what_its_observer_reads(rig_text: str) -> None:
    derived = "derived:\n  cart_mean.speed: {is: 'mean(cart.speed, 0.1 s)'}\n"
    rig = parse_rig(with_observers(rig_text, GOOD + derived), FILE)
    kept = only(rig, ["cart_mean"])
    assert set(kept.devices) == {"cart_mean", "cart", "carriage", "accelerometer"}


@pytest.mark.parametrize(
    ("old", "new", "token", "part"),
    [
        ("model: linear", "model: linaer", "linaer", "did you mean 'linear'?"),
        ("cart:", "carriage:", "carriage:", "is a device of this rig"),
        ("cart:", "cycle:", "cycle:", "is taken"),
        ("carriage.position", "carriage.positon", "carriage.positon", "'carriage.position'?"),
        ("accelerometer.acceleration", "a.b", "a.b", "unknown channel 'a.b'"),
        ("[carriage.position]", "[carriage.position, carriage.position]", "carriage.position]",
         "stands twice"),
        ("bias: m/s^2", "bias: mm/s^2", "mm/s^2", "not an SI unit"),
        ("bias: m/s^2", "bias: furlong", "furlong", "unknown unit"),
        ("bias: m/s^2", "position_sd: m/s^2", "position_sd", "a channel position_sd of its own"),
        ("[0, 0, 0]]\n    b", "[0, 0]]\n    b", "[[0, 1, 0]", "3 rows of 3, found 3x2/3"),
        ("b: [[0], [1], [0]]", "b: [[0], [1]]", "[[0], [1]]", "3 rows of 1, found 2x1"),
        ("    b: [[0], [1], [0]]\n", "", "model", "key 'b' is missing"),
        ("c: [[1, 0, 0]]", "c: [[1 m, 0, 0]]", "1 m", "a plain number"),
        ("c: [[1, 0, 0]]", "c: [[0, 1, 0]]", "[[0, 1, 0]]", "do not show position"),
        ("c: [[1, 0, 0]]", "c: [[0, 0, 0]]", "[[0, 0, 0]]", "do not show position"),
        ("1e2 mm^2/s^3", "1e2 mm^2/s^2", "1e2 mm", "give it m^2/s^3"),
        ("1e2 mm^2/s^3", "-1", "[0, -1", "`q` is not a covariance"),
        ("r: [1e-10]", "r: [0.0]", "[0.0]", "only positive eigenvalues"),
        ("r: [1e-10]", "r: [1e-10, 1]", "[1e-10, 1]", "1 numbers needed, found 2"),
        ("[0, 1, 0], [0, 0, 1e-2]]", "[0, 1, 2], [0, 0, 1e-2]]", "2], [0, 0, 1e-2", "not symm"),
        ("[0, 1, 0], [0, 0, 1e-2]]", "[0, 1, 2], [0, 2, 1]]", "[[1, 0, 0], [0, 1, 2]", "not a cov"),
        ("[0, 1, 0], [0, 0, 1e-2]]", "[0, 1, 0], 1]", "[[1, 0, 0], [0, 1, 0], 1", "either a list"),
        ("20 mm", "20 s", "20 s", "give it m"),
        ("20 mm", "abc", "abc", "cannot read 'abc'"),
        ("[[0, 1, 0], [", "[[1e9, 1, 0], [", "[[1e9", "overflow"),
        ("    r: [1e-10]", "    rr: [1e-10]", "rr:", "unknown key 'rr'"),
        ("    r: [1e-10]", "    r: [1e-10]\n    lost_after: 0 s", "0 s", "above 0 s"),
        ("[carriage.position]", "[far.away]", "far.away", "is a derived channel"),
    ],
)  # fmt: skip
def test_wrong_observer_names_its_place(
    rig_text: str, old: str, new: str, token: str, part: str
) -> None:
    assert old in GOOD
    observers = GOOD.replace(old, new)
    derived = "derived:\n  far.away: {is: 2 * carriage.position}\n"
    text = with_observers(rig_text, observers + derived)
    with pytest.raises(ConfigError) as caught:
        parse_rig(text, FILE)
    found = [caught.value, *caught.value.others]
    fitting = [error for error in found if part in f"{error.message} {error.hint}"]
    assert fitting, [str(error) for error in found]
    at = text.index("observers:") + observers.index(token)
    place = fitting[0].place
    assert place is not None
    assert place.line == text[:at].count("\n") + 1
    assert place.column == at - text[:at].rfind("\n")


def test_channel_slower_than_lost_after_is_named() -> None:
    path = shipped_folder("configs") / "sim_approach_angle.yaml"
    observers = """\
observers:
  turn:
    model: linear
    states: {angle: rad, rate: rad/s}
    measured: [daq.wheel_angle]
    a: [[0, 1], [0, 0]]
    c: [[1, 0]]
    q: [0, 1]
    r: [1e-6]
    x0: [0, 0]
    p0: [1, 1]
    lost_after: 2 ms
"""
    text = path.read_text().replace("interlocks:\n", f"{observers}\ninterlocks:\n", 1)
    with pytest.raises(ConfigError, match=r"readings of daq.wheel_angle may come .* s apart"):
        parse_rig(text, path)
    assert "turn" in parse_rig(text.replace("2 ms", "1 s"), path).devices


def test_slow_device_needs_a_stated_lost_after() -> None:
    path = shipped_folder("configs") / "wire_lugre.yaml"
    observers = """\
observers:
  weight:
    model: linear
    states: {load: kg}
    measured: [scale.mass]
    a: [[0]]
    c: [[1]]
    q: [1e-6]
    r: [1e-6]
    x0: [0]
    p0: [1]
"""
    text = path.read_text().replace("interlocks:\n", f"{observers}\ninterlocks:\n", 1)
    with pytest.raises(ConfigError, match=r"scale.mass come at a pace of their own"):
        parse_rig(text, path)
    stated = text.replace("p0: [1]", "p0: [1]\n    lost_after: 2 s")
    assert "weight" in parse_rig(stated, path).devices
