"""The unit in which people read a channel: declared by a driver, or by `display` of a device."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.config.checks.following import blind_below, unseen_levels
from rigd.config.loader import parse_rig
from rigd.model import ConfigError
from rigd.model.channels import Channel

FILE = Path("rig.yaml")
RIG = r"""
rig: oven
title: An oven with a fan
cycle: 100 Hz
devices:
  oven:
    driver: line-outputs
    options:
      port: tcp://127.0.0.1:9
      ask: 'MEAS?\n'
      separator: ';'
      columns: [heat, fan]
      channels:
        heat: {unit: degC, low: -50 degC, high: 400 degC}
        fan: {unit: rad/s, low: 0 rad/s, high: 1000 rad/s}
      outputs:
        fan: {unit: rad/s, low: 0 rad/s, high: 500 rad/s, write: 'F {fan:.1f}\n'}
      safe: 'OFF\n'
      state: {ask: 'ON?\n', safe: '0', ready: '1'}
    display: {fan: rpm}
    limits:
      fan: {low: 0 rpm, high: 3000 rpm, rate: 100 rad/s^2}
    waiver: {by: A. Person, reason: The emergency stop cuts its mains}
interlocks:
  - {name: hot, source: oven.heat, high: 260 degC, action: abort, message: Too hot.}
  - {name: follows, source: oven.fan, follows: oven.fan, band: 20 rad/s, delay: 1 s,
     action: abort, message: The fan does not turn.}
derived:
  above.zero: {is: oven.heat, unit: degC}
  room.rise: {is: oven.heat - 20 degC}
"""


def shown(name: str) -> str:
    channel = parse_rig(RIG, FILE).channel(name)
    assert channel is not None
    return f"{channel.unit} as {channel.shown_in}"


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("oven.heat", "K as degC"),
        ("oven.fan", "rad/s as rpm"),
        ("above.zero", "K as degC"),
        ("room.rise", "K as K"),
    ],
)
def test_channel_is_in_si_and_shown_otherwise(name: str, unit: str) -> None:
    assert shown(name) == unit


def test_setpoint_is_shown_as_its_channel() -> None:
    setpoint = parse_rig(RIG, FILE).setpoint("oven.fan")
    assert setpoint is not None
    assert setpoint.shown_in == "rpm"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("display: {fan: rpm}", "display: {fun: rpm}", "20:15: oven has no channel 'fun'"),
        ("display: {fan: rpm}", "display: {fan: K}", "20:20: fan is in rad/s, not in K"),
        ("display: {fan: rpm}", "display: {fan: rpms}", "unknown unit 'rpms'"),
        ("high: 260 degC", "high: 260", "25:42: 260 has no unit: write '260 degC'"),
        ("high: 260 degC", "high: 401 degC", "401 degC is above 400 degC"),
        ("high: 3000 rpm", "high: 3000", "3000 has no unit: write '3000 rpm'"),
        ("high: 3000 rpm", "high: 6000 rpm", "6000 rpm is above 4774.65 rpm"),
    ],
)
def test_mistake_is_named_in_display_unit(old: str, new: str, words: str) -> None:
    assert old in RIG
    with pytest.raises(ConfigError) as refused:
        parse_rig(RIG.replace(old, new), FILE)
    assert words in str(refused.value)


def test_display_of_another_kind_is_no_channel() -> None:
    with pytest.raises(ValueError, match="is in K, not in bar"):
        Channel("heat", "K", display="bar")


def test_band_beyond_setpoints_is_named_with_numbers() -> None:
    rig = parse_rig(RIG, FILE)
    levels = [("slow", "oven.fan", 10.0), ("off", "oven.fan", 0.0), ("fast", "oven.fan", 200.0)]
    (text,) = unseen_levels(rig, levels)
    assert "follows does not notice a drive that gives nothing in step 'slow'" in text
    assert "oven.fan is 95.493 rpm there, within its band of 190.986 rpm" in text
    assert unseen_levels(rig, [("fast", "oven.fan", 20.0)]) == []


def test_narrowest_of_two_interlocks_sees_most() -> None:
    lock = RIG[RIG.index("  - {name: follows") : RIG.index("derived:")]
    wide = lock.replace("name: follows", "name: wide").replace("band: 20", "band: 60")
    for both in (lock + wide, wide + lock):
        rig = parse_rig(RIG.replace(lock, both), FILE)
        assert unseen_levels(rig, [("middle", "oven.fan", 40.0)]) == []
        (text,) = unseen_levels(rig, [("slow", "oven.fan", 10.0)])
        assert text.startswith("interlock follows does not notice")


@pytest.mark.parametrize(("band", "count"), [("20 rad/s", 0), ("60 rad/s", 1)])
def test_wide_band_is_named_for_the_rig(band: str, count: int) -> None:
    rig = parse_rig(RIG.replace("band: 20 rad/s", f"band: {band}"), FILE)
    assert len(blind_below(rig)) == count
