"""A rig file that describes lines wrongly is refused with its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.config.loader import parse_rig
from rigd.model.errors import ConfigError

RIG = r"""rig: bench
title: bench
cycle: 100 Hz
interlocks: []
devices:
  gauge:
    driver: lines
    options:
      port: /dev/ttyUSB0
      stop_bits: 2
      ask: '?\r\n'
      decimal: point
      separator: ','
      pattern: '(?P<force>[-+\d.]+) N (?P<temp>.*) C'
      channels:
        force: {unit: kN, low: -5 kN, high: 5 kN}
        temp: degC
"""
PATTERN = r"pattern: '(?P<force>[-+\d.]+) N (?P<temp>.*) C'"


def test_channels_carry_si_units_and_ranges() -> None:
    rig = parse_rig(RIG, Path("rig.yaml"))
    force, temp = rig.devices["gauge"].channels
    assert (force.name, force.unit, force.low, force.high) == ("force", "N", -5000.0, 5000.0)
    assert (temp.name, temp.unit) == ("temp", "K")


@pytest.mark.parametrize(
    ("right", "wrong", "place", "words"),
    [
        ("unit: kN", "unit: kX", "16:23", "unknown unit 'kX'"),
        ("temp: degC", "temp: {unit: 0 K}", "17:22", "cannot mean 0"),
        ("low: -5 kN", "low: -5 kg", "16:32", "'-5 kg' is in kg, expected kN"),
        ("low: -5 kN", "low: 6 kN", "16:44", "low 6 kN is not below high 5 kN"),
        ("?P<force>", "?P<forc>", "14:16", "group 'forc' has no entry in `channels`"),
        ("(?P<temp>.*)", "21", "14:16", "no group 'temp', which `channels` has"),
        ("?P<force>", "?P<force>(", "14:16", "is no regular expression: missing )"),
        (PATTERN, "columns: [force, force]", "14:16", "'force' stands here twice"),
        (PATTERN, "columns: [force]", "14:16", "no column 'temp'"),
        (PATTERN, "columns: [force, temp, x]", "14:16", "column 'x' has no entry"),
        (PATTERN, "", "9:7", "either 'pattern' or 'columns'"),
        (PATTERN, f"{PATTERN}\n      columns: [force, temp]", "15:16", "either 'pattern'"),
        (r"'?\r\n'", r"'?\q'", "11:12", "is no escape"),
        (r"'?\r\n'", "µ", "11:12", "is not ASCII"),
        ("/dev/ttyUSB0", "tcp://gauge", "9:13", "not of the form tcp://HOST:PORT"),
        ("stop_bits", "stopp_bits", "10:7", "did you mean 'stop_bits'"),
        ("        temp:", "        Temp:", "17:9", "not a valid name"),
    ],
)
def test_mistake_is_refused_with_its_place(right: str, wrong: str, place: str, words: str) -> None:
    assert right in RIG
    with pytest.raises(ConfigError) as caught:
        parse_rig(RIG.replace(right, wrong), Path("rig.yaml"))
    found = str(caught.value)
    assert f"rig.yaml:{place}: " in found, found
    assert words in found


def test_comma_has_only_one_meaning() -> None:
    text = RIG.replace(PATTERN, "columns: [force, temp]").replace("point", "comma")
    with pytest.raises(ConfigError, match="a comma cannot be both"):
        parse_rig(text, Path("rig.yaml"))
