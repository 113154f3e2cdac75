"""The zero of an absolute encoder: positions on both sides of it are near it, at each opening."""

from __future__ import annotations

import math

import pytest
from support.can.bench import Connect, encoder
from support.can.script import encoder as scripted_encoder
from support.can.script import number

#: The encoder counts to 2^24, and has 4096 counts per turn.
SPAN = 1 << 24


@pytest.mark.parametrize("zero", [1000, SPAN // 2, SPAN - 1, -1000, 3 * SPAN + 5])
@pytest.mark.parametrize("away", [-600, 0, 600])
def test_position_at_opening_is_near_the_zero(connect: Connect, zero: int, away: int) -> None:
    node = scripted_encoder()
    shown = number((zero + away) % SPAN, 4)
    node.objects[0x6004, 0] = shown
    bus, port = connect(node)
    driver = encoder(bus, zero=f"{zero} count")
    driver.open()
    port.say(0x18B, shown)
    driver.link.begin(0)
    row = driver.read(0)
    assert row is not None
    assert row[0] == pytest.approx(away / 4096 * 2 * math.pi)
    assert row[1] == zero + away
