"""Analogue sensors on a card: scale, zero, rails."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError
from support.cards.card import BenchMf624, Terminals

from rigd.sdk import LinkError
from rigd_drivers.cards.analog import CardAnalog, CardAnalogConfig

LSB = 20 / 0x4000
ACCELERATION = {
    "name": "acceleration",
    "input": 3,
    "unit": "m/s^2",
    "scale": "981 cm/s^2/V",
    "zero": "0.5 V",
}
FORCE = {"name": "force", "input": 0, "unit": "N", "scale": "-50 N/V"}


def sensors(*inputs: dict[str, Any]) -> tuple[CardAnalog, Terminals, BenchMf624]:
    terminals = Terminals()
    link = BenchMf624(terminals.card())
    driver = CardAnalog(CardAnalogConfig.model_validate({"inputs": inputs}), link)
    link.open()
    driver.open()
    return driver, terminals, link


def test_row_has_values_and_volts_in_order() -> None:
    driver, terminals, link = sensors(ACCELERATION, FORCE)
    terminals.volts_in[0], terminals.volts_in[3] = 2.0, 1.5
    link.begin(0)
    acceleration, acceleration_raw, force, force_raw, status = driver.read(0)
    assert acceleration == pytest.approx(9.81, abs=10 * LSB)
    assert acceleration_raw == pytest.approx(1.5, abs=LSB)
    assert force == pytest.approx(-100.0, abs=50 * LSB)
    assert force_raw == pytest.approx(2.0, abs=LSB)
    assert status == 0
    channels = driver.declaration.channels
    names = [(channel.name, channel.unit, channel.raw_of) for channel in channels]
    assert names == [
        ("acceleration", "m/s^2", None),
        ("acceleration_raw", "V", "acceleration"),
        ("force", "N", None),
        ("force_raw", "V", "force"),
    ]
    ranges = [(channel.low, channel.high) for channel in channels[::2]]
    assert ranges == [(pytest.approx(-103.005), pytest.approx(93.195)), (-500.0, 500.0)]


@pytest.mark.parametrize(
    ("volts", "fault", "status"),
    [
        ((9.99, 0.0), None, 0b00),
        ((12.0, 0.0), None, 0b01),
        ((0.0, -10.0), None, 0b10),
        ((0.0, 0.0), {"fault": "saturation", "input": 0, "rail": "low"}, 0b10),
    ],
)
def test_an_input_at_a_rail_is_flagged(
    volts: tuple[float, float], fault: dict[str, Any] | None, status: int
) -> None:
    terminals = Terminals()
    card = terminals.card()
    link = BenchMf624(card)
    driver = CardAnalog(CardAnalogConfig.model_validate({"inputs": [ACCELERATION, FORCE]}), link)
    link.open()
    driver.open()
    terminals.volts_in[3], terminals.volts_in[0] = volts
    if fault is not None:
        card.inject(**fault)
    link.begin(0)
    assert driver.read(0)[-1] == status


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scale": "9.81 m/s^2"}, r"scale '9\.81 m/s\^2' of acceleration is not in m/s\^2/V"),
        ({"scale": "0 m/s^2/V"}, "must not be 0"),
        ({"unit": "K"}, r"'981 cm/s\^2/V' of acceleration is not in K/V"),
        ({"zero": "0.5 A"}, "expected V"),
        ({"name": "Beschleunigung"}, "should match pattern"),
    ],
)
def test_wrong_options_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        CardAnalogConfig.model_validate({"inputs": [ACCELERATION | change]})


def test_names_must_differ_with_those_of_the_volts() -> None:
    with pytest.raises(ValidationError, match="two channels are called 'force_raw'"):
        CardAnalogConfig.model_validate({"inputs": [FORCE, FORCE | {"name": "force_raw"}]})
    with pytest.raises(ValidationError, match="at least 1 item"):
        CardAnalogConfig.model_validate({"inputs": []})


def test_input_that_card_has_not_is_refused() -> None:
    with pytest.raises(LinkError, match="no analogue input 8"):
        sensors(FORCE | {"input": 8})
