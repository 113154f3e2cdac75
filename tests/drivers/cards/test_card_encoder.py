"""Encoders on a card: unwrapped, zeroed, scaled, and jumps separated from motion."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from support.cards.card import BenchMf624, Terminals

from rigd.sdk import DeviceError
from rigd_drivers.cards.encoder import CardEncoder, CardEncoderConfig

ANGLE: dict[str, Any] = {
    "encoder": 0,
    "quantity": "angle",
    "counts_per_revolution": "1024 count/rev",
    "gear_ratio": 20.25,
    "fastest": "1e15 count/s",
}


class Rig:
    def __init__(self, start: int = 0, **options: Any) -> None:
        self.terminals = Terminals(counts=[start, 0, 0, 0])
        self.card = self.terminals.card()
        self.link = BenchMf624(self.card)
        self.encoder = CardEncoder(CardEncoderConfig.model_validate(ANGLE | options), self.link)
        self.link.open()
        self.encoder.open()

    def at(self, counts: int) -> tuple[float, ...]:
        """Return the row once the encoder has made ``counts``."""
        self.terminals.counts[0] = counts
        self.link.begin(0)
        return tuple(self.encoder.read(0))


def test_gear_ratio_scales_the_angle() -> None:
    angle, counts, index = Rig(start=77).at(77 + 20736)
    assert (counts, index) == (20736, 0)
    assert angle == pytest.approx(2 * math.pi)


def test_inverted_encoder_reverses_the_position() -> None:
    options = {"quantity": "position", "distance_per_count": "30 um/count", "inverted": True}
    rig = Terminals()
    link = BenchMf624(rig.card())
    config = CardEncoderConfig.model_validate(
        {"encoder": 1, "fastest": ANGLE["fastest"], **options}
    )
    encoder = CardEncoder(config, link)
    link.open()
    encoder.open()
    rig.counts[1] = 100
    link.begin(0)
    assert encoder.read(0) == (pytest.approx(-3e-3), 100.0, 0)
    assert [channel.name for channel in encoder.declaration.channels] == ["position", "counts"]


@given(
    start=st.integers(-(2**40), 2**40),
    steps=st.lists(st.integers(-(2**31), 2**31 - 1), min_size=1, max_size=20),
)
def test_a_counter_of_32_bits_is_unwrapped(start: int, steps: list[int]) -> None:
    rig = Rig(start)
    made = start
    for step in steps:
        made += step
        assert rig.at(made)[1] == made - start


def test_encoder_begins_at_zero_or_counter_value() -> None:
    assert Rig(start=-5).at(-4)[1] == 1
    assert Rig(start=-5, zero_at_open=False).at(-4)[1] == -4


def test_index_of_own_encoder_is_in_row() -> None:
    rig = Rig()
    rig.terminals.index[1] = True
    assert rig.at(0)[-1] == 0, "that of another encoder"
    rig.terminals.index[0] = True
    assert rig.at(0)[-1] == 1


def test_reset_counter_is_not_read_as_motion() -> None:
    rig = Rig(start=-40_000_000, zero_at_open=False, fastest="100000 count/s")
    rig.card.inject("index_reset", encoder=0)
    with pytest.raises(DeviceError, match=r"encoder 0 jumped by 40000000 counts"):
        rig.at(-40_000_000)


def test_standing_encoder_may_flicker_by_one_count() -> None:
    rig = Rig(fastest="1e-3 count/s")
    assert [rig.at(counts)[1] for counts in (1, 0, -1, 0)] == [1, 0, -1, 0]


def test_encoder_that_counts_wrong_way_shows_it() -> None:
    """The signal does not show it; a run finds it by its end conditions."""
    rig = Rig()
    rig.at(1000)
    rig.card.inject("sign_flip", encoder=0)
    assert rig.at(1000)[1] == 1000
    assert rig.at(1500)[1] == 500


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"quantity": "angle", "distance_per_count": "1 um/count"}, "belongs to 'quantity: posit"),
        ({"quantity": "position", "gear_ratio": 2}, "belongs to 'quantity: angle'"),
        ({"quantity": "position"}, "needs 'distance_per_count'"),
    ],
)
def test_options_of_the_other_quantity_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        CardEncoderConfig.model_validate({"encoder": 0, **options})
