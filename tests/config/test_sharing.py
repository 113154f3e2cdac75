"""What only one device can have is refused at the second, before anything is opened."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.config.loader import parse_rig
from rigd.model.errors import ConfigError
from rigd.sdk.shipped_files import shipped_configs

CARD = (shipped_configs() / "card_lugre.yaml").read_text()
SERIAL = """
rig: two-1
title: Two devices on serial ports
cycle: 100 Hz
devices:
  scale:
    driver: serial-scale
    options: {port: /dev/ttyUSB0, dialect: mt-sics}
  cell:
    driver: modbus-transmitter
    options: {serial_port: /dev/ttyUSB1, map: seneca-z-sg2, scale: 1 N/count, low: -1 N, high: 1 N}
  other:
    driver: modbus-transmitter
    options: {host: cell, map: seneca-z-sg2, scale: 1 N/count, low: -1 N, high: 1 N}
  third:
    driver: modbus-transmitter
    options: {host: cell, unit: 2, map: seneca-z-sg2, scale: 1 N/count, low: -1 N, high: 1 N}
interlocks: []
"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("monitor_input: 2", "monitor_input: 0", "analogue input 0 is used twice"),
        ("input: 1\n", "input: 0\n", "analogue input 0 is used twice"),
        ("set_output: 1\n", "set_output: 0\n", "analogue output 0 is used twice"),
        ("set_output: 1\n", "set_output: 9\n", "no analogue output 9; it has 0 to 7"),
        ("enable_output: 1\n", "enable_output: 0\n", "digital output 0 is used twice"),
        ("enable_output: 1\n", "enable_output: 7\n", "digital output 7 is used twice"),
        ("clutch_output: 2", "clutch_output: 3", "digital output 3 is used twice"),
        ("encoder: 2\n", "encoder: 4\n", "no encoder 4"),
        ("behind_one_shot: true", "behind_one_shot: true\n      enable_active: low",
         "stands low at rest, which enables the drive"),
    ],
)  # fmt: skip
def test_wiring_that_cannot_be_is_refused_by_check(old: str, new: str, words: str) -> None:
    assert old in CARD
    with pytest.raises(ConfigError, match=words) as caught:
        parse_rig(CARD.replace(old, new, 1), shipped_configs() / "card.yaml")
    assert caught.value.place is not None


def test_serial_port_of_two_devices_is_refused() -> None:
    parse_rig(SERIAL, Path("rig.yaml"))
    with pytest.raises(ConfigError, match="scale uses /dev/ttyUSB0 already") as caught:
        parse_rig(SERIAL.replace("ttyUSB1", "ttyUSB0"), Path("rig.yaml"))
    assert caught.value.place is not None
    assert caught.value.place.line == 11
