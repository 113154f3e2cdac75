"""The action `preset` of a CiA 406 encoder: the count of the present position, set by object 6003.

The count is no movement: neither the unwrapped counts nor the zero may see a jump.
"""

from __future__ import annotations

import math

import pytest
from pydantic import ValidationError
from support.can.bench import Clock, Connect, encoder, encoder_config
from support.can.script import ScriptedBus, ScriptedNode, number
from support.can.script import encoder as scripted_encoder

from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd_drivers.can.cia406_encoder import Cia406Encoder

PRESET, POSITION = (0x6003, 0), (0x6004, 0)


class Presettable(ScriptedNode):
    """An encoder that takes the preset value for its position."""

    def written(self, address: tuple[int, int], value: bytes) -> None:
        if address == PRESET:
            self.objects[POSITION] = value


def made(kind: type[ScriptedNode] = Presettable, at: int = 3000) -> ScriptedNode:
    node = kind(11, scripted_encoder().objects)
    node.objects |= {PRESET: number(0, 4), POSITION: number(at, 4)}
    return node


def opened(connect: Connect, node: ScriptedNode, **options: object) -> Cia406Encoder:
    bus, _ = connect(node)
    driver = encoder(bus, **{"preset": 1000, **options})
    driver.open()
    return driver


def cycled(driver: Cia406Encoder, port: ScriptedBus, count: int | None = None) -> float | None:
    if count is not None:
        port.say(0x18B, number(count, 4))
    driver.link.begin(0)
    row = driver.read(0)
    driver.link.end(0)
    return None if row is None else row[0]


def reply(driver: Cia406Encoder, cycles: int = 20) -> str | None:
    for _ in range(cycles):
        driver.link.begin(0)
        if (told := driver.acted()) is not None:
            return told
        driver.link.end(0)
    return None


def test_answer_that_comes_during_a_stall_is_taken(connect: Connect, clock: Clock) -> None:
    node = made()
    bus, port = connect(node)
    driver = encoder(bus, preset=1000)
    driver.open()
    driver.act("preset")
    assert driver.acted() is None
    driver.link.end(0)
    held = list(port.coming)
    port.coming.clear()
    driver.link.begin(0)
    port.coming += held  # within a cycle this computer stands still
    clock.pass_by(60.0)
    assert driver.acted() is None
    driver.link.end(0)
    assert "shows 1000 counts" in (reply(driver) or "")


def test_preset_becomes_count_without_a_movement(connect: Connect) -> None:
    node = made()
    bus, port = connect(node)
    driver = encoder(bus, preset=1000, zero="0 count")
    driver.open()
    assert cycled(driver, port, 3000) == pytest.approx(3000 / 4096 * 2 * math.pi)
    driver.act("preset")
    told = reply(driver)
    assert told is not None and "shows 1000 counts, before 3000" in told
    assert node.objects[PRESET] == number(1000, 4)
    assert cycled(driver, port, 1001) == pytest.approx(1001 / 4096 * 2 * math.pi)
    assert driver.acted() is None  # told once


def test_preset_forgets_turns_beyond_range(connect: Connect) -> None:
    node = made(at=0)
    node.objects[0x6502, 0] = number(1, 2)  # 4096 counts, then from 0 again
    bus, port = connect(node)
    driver = encoder(bus, preset=1000, zero="0 count")
    driver.open()
    for count in (1500, 3000, 400, 1900, 3400, 800):  # twice past the end
        cycled(driver, port, count)
    node.objects[POSITION] = number(800, 4)
    driver.act("preset")
    assert reply(driver) is not None
    assert cycled(driver, port, 1000) == pytest.approx(1000 / 4096 * 2 * math.pi)


def test_own_zero_begins_again_at_preset(connect: Connect) -> None:
    bus, port = connect(made())
    driver = encoder(bus, preset=1000)
    driver.open()
    driver.act("preset")
    assert reply(driver) is not None
    assert cycled(driver, port, 1000) == 0.0


def test_cycle_never_waits_for_preset(connect: Connect) -> None:
    node = made()
    driver = opened(connect, node)
    node.silent = True
    driver.act("preset")
    assert reply(driver, cycles=3) is None


def test_preset_that_is_not_heeded_is_an_error(connect: Connect) -> None:
    driver = opened(connect, made(ScriptedNode))
    driver.act("preset")
    with pytest.raises(DeviceError, match="preset value 1000 and shows 3000, before 3000"):
        reply(driver)
    driver.act("preset")  # it may be tried again


def test_refused_preset_names_object_and_abort(connect: Connect) -> None:
    node = made()
    node.refuse[PRESET] = 0x0800_0022
    driver = opened(connect, node)
    driver.act("preset")
    with pytest.raises(ProtocolError, match=r"1000 .* 6003:00 .*0x08000022"):
        reply(driver)


def test_silent_encoder_ends_the_preset(connect: Connect, clock: Clock) -> None:
    node = made()
    driver = opened(connect, node)
    node.silent = True
    driver.act("preset")
    reply(driver, cycles=2)
    clock.pass_by(0.6)
    with pytest.raises(LinkError, match=r"does not answer within 0\.5 s"):
        reply(driver)


def test_preset_beyond_range_of_counts_is_refused(connect: Connect) -> None:
    driver = opened(connect, made(), preset=1 << 30)
    driver.act("preset")
    with pytest.raises(DeviceError, match="`preset` is 1073741824"):
        reply(driver)


def test_encoder_without_option_has_no_preset(connect: Connect) -> None:
    assert not Cia406Encoder.declare(encoder_config()).actions
    driver = opened(connect, made(), preset=None)
    with pytest.raises(ValueError, match="no action 'preset'"):
        driver.act("preset")
    with pytest.raises(ValidationError, match="preset"):
        encoder_config(preset=-1)


def test_linear_encoder_without_6004_has_preset_6010(connect: Connect) -> None:
    node = made(ScriptedNode)
    del node.objects[POSITION], node.objects[0x6501, 0], node.objects[0x6502, 0]
    node.objects |= {(0x6020, 1): number(1000, 4), (0x6010, 1): number(0, 4)}
    driver = opened(connect, node, kind="linear", distance_per_count="5 um/count")
    driver.act("preset")
    assert "shows 1000 counts" in (reply(driver) or "")
    assert node.objects[0x6010, 1] == number(1000, 4)
