"""The CiA 404 transmitter: frames of Baumer's manual, units and tare."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from pydantic import ValidationError
from support.can.bench import Clock, Connect
from support.can.bus import Client, on_loop
from support.can.script import ScriptedBus, ScriptedNode, common, number

from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd_drivers import device_file
from rigd_drivers.can.cia404_transmitter import Cia404Transmitter, TransmitterConfig
from rigd_drivers.can.profile import TransmitterProfile
from rigd_sim.wire.can.hub import CanHub
from rigd_sim.wire.can.transmitter import Cia404Transmitter as SimulatedTransmitter

NODE, TPDO = 21, 0x195
ZERO = bytes.fromhex("7a 65 72 6f")  # manual, page 35
OPTIONS = {"node": NODE, "unit": "5 N", "low": "-1500 N", "high": "1500 N"}
STATUS = [0x7130_0110, 0x6150_0108]


class Strain(ScriptedNode):
    """A strain sensor that takes "zero" as the manual has it."""

    def written(self, address: tuple[int, int], value: bytes) -> None:
        if address == (0x6125, 1) and value == ZERO:
            self.objects[0x7130, 1] = number(0, 2)


def strain(kind: type[ScriptedNode] = Strain) -> ScriptedNode:
    """The sensor of the manual: 3.00 um/m with two digits (pages 35 and 36)."""
    node = kind(NODE, common(NODE, 0x194, 4711))
    node.objects |= {
        (0x2112, 1): bytes.fromhex("30 71"),
        (0x6125, 1): bytes(4),
        (0x6131, 1): bytes.fromhex("00 01 01 fa"),
        (0x6132, 1): bytes.fromhex("02"),
        (0x6150, 1): bytes(1),
        (0x7130, 1): bytes.fromhex("2c 01"),
    }
    return node


def config(**options: object) -> TransmitterConfig:
    return TransmitterConfig.model_validate(OPTIONS | options)


def opened(
    connect: Connect, node: ScriptedNode, **options: object
) -> tuple[Cia404Transmitter, ScriptedBus]:
    bus, port = connect(node)
    driver = Cia404Transmitter(config(**options), bus)
    driver.open()
    return driver, port


def row(driver: Cia404Transmitter, port: ScriptedBus, data: str) -> tuple[float, ...] | None:
    port.say(TPDO, bytes.fromhex(data))
    driver.link.begin(0)
    found = driver.read(0)
    driver.link.end(0)
    return None if found is None else tuple(found)


def tared(driver: Cia404Transmitter) -> str | None:
    for _ in range(20):
        driver.link.begin(0)
        if (told := driver.acted()) is not None:
            return told
        driver.link.end(0)
    return None


def test_frames_of_the_manual_become_a_force(connect: Connect) -> None:
    driver, port = opened(connect, strain(), profile="baumer-strainlink", physical_unit=0xFA010100)
    assert row(driver, port, "2c 01 00") == pytest.approx((15.0, 300, 0))  # 3.00 um/m
    assert row(driver, port, "d4 fe 00") == pytest.approx((-15.0, -300, 0))
    for status in (3, 5):  # overflow and underflow of its converter, page 36
        found = row(driver, port, f"ff 7f {status:02x}")
        assert found is not None and math.isnan(found[0])
        assert found[2] == status
    assert "1 count = 0.05 N (2 decimal digits" in driver.identity
    assert "Baumer StrainLink DSRT (from the manual" in driver.identity


def test_value_and_status_are_mapped_at_every_sync(connect: Connect) -> None:
    node = strain()
    opened(connect, node)
    assert node.objects[0x1800, 2] == b"\x01"
    assert [int.from_bytes(node.objects[0x1A00, n], "little") for n in (1, 2)] == STATUS
    node = strain()
    profile = {"title": "t", "source": "s", "status": False}
    driver, port = opened(connect, node, profile=profile)
    assert node.objects[0x1A00, 0] == b"\x01"
    assert row(driver, port, "2c 01") == pytest.approx((15.0, 300, 0))


def test_value_of_32_bits_is_an_object_choice(connect: Connect) -> None:
    node = strain()
    node.objects[0x9130, 1] = number(0, 4)
    value = {"object": "9130:01", "type": "int32"}
    driver, port = opened(connect, node, profile={"title": "t", "source": "s", "value": value})
    assert row(driver, port, "a0 86 01 00 00") == pytest.approx((5000.0, 100_000, 0))


def test_another_physical_unit_is_refused(connect: Connect) -> None:
    with pytest.raises(ProtocolError, match=r"unit 0xFA010100 .* `physical_unit` is 0x00210000"):
        opened(connect, strain(), physical_unit=0x00210000)


def test_value_of_24_bits_is_refused_by_profile(connect: Connect) -> None:
    node = strain()
    node.objects[0x2112, 1] = bytes.fromhex("30 81")
    with pytest.raises(ProtocolError, match=r"2112:01 .* is 33072, .* expects 28976"):
        opened(connect, node, profile="baumer-strainlink")


def test_tare_sends_zero_and_is_checked(connect: Connect) -> None:
    node = strain()
    driver, _ = opened(connect, node)
    driver.act("tare")
    assert "shows 0 counts, before 300" in (tared(driver) or "")
    driver, _ = opened(connect, strain(ScriptedNode))
    driver.act("tare")
    with pytest.raises(DeviceError, match="ordered to zero and shows 300 counts, before 300"):
        tared(driver)


def test_transmitter_that_states_no_sizes_is_tared(connect: Connect) -> None:
    node = strain()
    node.sized = False
    driver, _ = opened(connect, node)
    driver.act("tare")
    assert tared(driver) is not None
    assert node.objects[0x7130, 1] == number(0, 2)


def test_tare_without_answer_ends_with_its_cause(connect: Connect, clock: Clock) -> None:
    node = strain()  # out of its range it gives no answer, page 35
    driver, _ = opened(connect, node)
    node.silent = True
    driver.act("tare")
    assert tared(driver) is None
    clock.pass_by(0.6)
    with pytest.raises(LinkError, match=r"6125:01 \(autozero\)|7130:01"):
        tared(driver)


def test_options_that_cannot_be_are_refused() -> None:
    for wrong in ({"unit": "0 N"}, {"low": "2000 N"}, {"profile": "hbk"}):
        with pytest.raises(ValidationError, match=r"unit|low|baumer-strainlink"):
            config(**wrong)
    without = {"title": "t", "source": "s", "tare": False}
    assert not Cia404Transmitter.declare(config(profile=without)).actions
    assert "tare" in Cia404Transmitter.declare(config()).actions


def test_shipped_profile_matches_its_manual() -> None:
    (path,) = device_file.shipped("cia404")
    profile = device_file.read(path, TransmitterProfile, path)
    assert (path.stem, profile.seen, profile.vendor) == ("baumer-strainlink", False, None)
    assert "pages 34" in profile.source
    assert profile.value.object == "7130:01"


@on_loop
async def test_simulated_sensor_answers_as_the_manual(tmp_path: Path) -> None:
    golden = {  # requests and answers of pages 34 to 36
        "40 31 61 01 00 00 00 00": "43 31 61 01 00 01 01 fa",
        "40 32 61 01 00 00 00 00": "4f 32 61 01 02 00 00 00",
        "40 50 61 01 00 00 00 00": "4f 50 61 01 00 00 00 00",
        "40 30 71 01 00 00 00 00": "4b 30 71 01 2c 01 00 00",
        "40 12 21 01 00 00 00 00": "4b 12 21 01 30 71 00 00",
        "23 25 61 01 7a 65 72 6f": "60 25 61 01 00 00 00 00",
    }
    hub = CanHub("bus", tmp_path / "bus")
    node = SimulatedTransmitter("cell", hub, NODE, lambda _: 3.0)
    await hub.start()
    client = Client(tmp_path / "bus")
    await node.start()
    await client.receive()
    for request, answer in golden.items():
        assert await client.sdo(NODE, request) == answer
    assert await client.sdo(NODE, "40 30 71 01 00 00 00 00") == "4b 30 71 01 00 00 00 00"
    client.close()
    await node.stop()
    await hub.stop()
