"""What the counts of an encoder are: its own steps, scaled units, or steps along a line."""

from __future__ import annotations

import math

import pytest
from support.can.bench import Connect, encoder
from support.can.script import ScriptedBus, ScriptedNode, number
from support.can.script import encoder as scripted_encoder

from rigd.sdk import ProtocolError
from rigd_drivers.can.cia406_encoder import Cia406Encoder

Objects = dict[tuple[int, int], int | None]
LINE = {"kind": "linear", "distance_per_count": "5 um/count"}
#: As delivered: 16 bits per turn, of which the position shows 13; 4096 turns.
SCALED: Objects = {
    (0x6000, 0): 4,
    (0x6001, 0): 8192,
    (0x6002, 0): 8192 * 4096,
    (0x6501, 0): 65536,
}


def made(objects: Objects) -> ScriptedNode:
    node = scripted_encoder()
    for address, value in objects.items():
        if value is None:
            node.objects.pop(address, None)
        else:
            size = 2 if address[0] in (0x6000, 0x6500, 0x6502) else 4
            node.objects[address] = number(value, size)
    return node


def values(driver: Cia406Encoder, port: ScriptedBus, *counts: int) -> list[float]:
    found = []
    for count in counts:
        port.say(0x18B, number(count, 4))
        driver.link.begin(0)
        row = driver.read(0)
        driver.link.end(0)
        assert row is not None
        found.append(row[0])
    return found


@pytest.mark.parametrize(
    ("objects", "per_turn", "span"),
    [
        (SCALED, 8192, 8192 * 4096),
        (SCALED | {(0x6000, 0): 0}, 65536, 65536 * 4096),
        (SCALED | {(0x6000, 0): None, (0x6500, 0): 4}, 8192, 8192 * 4096),
        # TR-ECE-BA-DGB-0080-05: 6000 has the counting direction alone, 6500 bit 2 the scaling.
        (SCALED | {(0x6000, 0): 0, (0x6500, 0): 4}, 8192, 8192 * 4096),
        (SCALED | {(0x6000, 0): 0, (0x6500, 0): 0}, 65536, 65536 * 4096),
        ({(0x6001, 0): 360, (0x6002, 0): 3600, (0x6000, 0): 5}, 360, 3600),
        ({(0x6502, 0): None}, 4096, 4096),  # a single turn
        ({(0x6502, 0): 1}, 4096, 4096),
    ],
)
def test_counts_are_those_of_the_setting(
    connect: Connect, objects: Objects, per_turn: int, span: int
) -> None:
    bus, port = connect(made(objects | {(0x6004, 0): 0}))
    driver = encoder(bus)
    driver.open()
    step = 2 * math.pi / per_turn
    quarter = span // 4
    over_the_end = [quarter, 2 * quarter, 3 * quarter, 0, span - 1]
    expected = [quarter, 2 * quarter, 3 * quarter, span, span - 1]
    assert values(driver, port, *over_the_end) == pytest.approx([n * step for n in expected])


def test_right_resolution_of_scaled_encoder_is_accepted(connect: Connect) -> None:
    bus, _ = connect(made(SCALED))
    driver = encoder(bus, counts_per_revolution="8192 count/rev")
    driver.open()
    driver.close()
    with pytest.raises(ProtocolError, match=r"has 8192 counts per revolution \(object 6001\)"):
        encoder(bus, counts_per_revolution="65536 count/rev", node=11).open()


@pytest.mark.parametrize("reported", [0xFFFF, 0, None])
def test_bits_give_turns_that_6502_lacks(connect: Connect, reported: int | None) -> None:
    # 2^20 turns of 4096 steps: 6502 has all of its 16 bits set, or gives the lower ones.
    bus, _ = connect(made({(0x6502, 0): reported, (0x6004, 0): 1 << 30}))
    driver = encoder(bus, bits=32)
    driver.open()
    assert driver._unwrap.span == 1 << 32


def test_turn_beyond_a_single_turn_is_an_error(connect: Connect) -> None:
    bus, port = connect(made({(0x6502, 0): None}))
    driver = encoder(bus)
    driver.open()
    with pytest.raises(ProtocolError, match="beyond its range of 4096"):
        values(driver, port, 4096)


def test_line_without_object_6004_is_read_at_6020(connect: Connect) -> None:
    line: Objects = {
        (0x6004, 0): None, (0x6501, 0): None, (0x6502, 0): None,
        (0x6020, 1): 100, (0x6005, 1): 5000,
    }  # fmt: skip
    node = made(line)
    bus, port = connect(node)
    driver = encoder(bus, **LINE)
    driver.open()
    assert node.objects[0x1A00, 1] == bytes.fromhex("20 01 20 60")
    assert values(driver, port, 300, -100) == pytest.approx([1e-3, -1e-3])
    driver.close()
    with pytest.raises(ProtocolError, match=r"5e-06 m \(object 6005:01\).* is 1e-05 m"):
        encoder(bus, **(LINE | {"distance_per_count": "10 um/count"})).open()


def test_linear_type_has_no_turns(connect: Connect) -> None:
    node = made({(0x1000, 0): 0x0008_0196, (0x6501, 0): 5000, (0x6004, 0): 70_000})
    bus, port = connect(node)
    driver = encoder(bus, **LINE)
    driver.open()
    assert values(driver, port, 70_200) == pytest.approx([1e-3])
