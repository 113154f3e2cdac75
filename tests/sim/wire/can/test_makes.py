"""Simulated drives of a make: golden frames of what their documents state and CiA 301 allows."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.can.bus import Client, on_loop
from support.can.nodes import CURRENT_DRIVE, SERVO, SPEED_DRIVE, cycle, drive, operational, written

from rigd_sim.lugre.wire import WireLugre, WireLugreConfig
from rigd_sim.wire.can.traits import DriveTraits, known_makes, read_make


async def uploaded(client: Client, where: str) -> int:
    """Return the value of an object, read in segments (CiA 301, 7.2.4.3.5)."""
    begun = await client.sdo(SERVO, f"40 {where} 00 00 00 00")
    assert begun[:2] == "41", begun
    size = int(begun.split()[4], 16)
    segment = bytes.fromhex(await client.sdo(SERVO, "60 00 00 00 00 00 00 00"))
    assert segment[0] == (7 - size) << 1 | 1  # toggle 0, so many bytes unused, the last
    return int.from_bytes(segment[1 : 1 + size], "little")


@on_loop
async def test_make_boots_twice_and_reports_start(tmp_path: Path) -> None:
    async with drive(tmp_path, make="maxon-epos4") as (_, client, _):
        assert await client.frames(3) == [
            (0x700 + SERVO, "00"),  # the second; the first was seen by the bench
            (0x080 + SERVO, "20 31 05 00 00 00 00 00"),  # 3120h, generic and voltage
            (0x080 + SERVO, "00 00 00 00 00 00 00 00"),  # no error
        ]


@pytest.mark.parametrize(
    ("make", "values"),
    [
        # DCF of an EPOS4: 1018:01, :02, 6502, 60A9; 1 A and 1.5 A in mA, 50 mN m in uN m.
        (
            "maxon-epos4",
            {"18 10 01": 0xFB, "18 10 02": 0x65520000, "02 65 00": 0x3A5, "a9 60 00": 0x00B44700,
             "01 30 01": 1000, "01 30 02": 1500, "01 30 05": 50000, "76 60 00": 50000},
        ),
        # EDS of the Elmo Gold, and its guide: mA, mN m; 6096 is 1 : 1.
        (
            "elmo-gold",
            {"18 10 01": 0x9A, "18 10 02": 0x30923, "75 60 00": 1000, "76 60 00": 50,
             "96 60 01": 1, "72 60 00": 50000},
        ),
        ("nanotec", {"3b 20 01": 1000, "75 60 00": 1000, "a9 60 00": 0x00B44700}),
        ("kollmorgen-akd", {"18 10 01": 0x6A, "02 65 00": 0x6D, "87 60 00": 2385}),
    ],
)  # fmt: skip
def test_make_has_objects_of_its_documents(
    tmp_path: Path, make: str, values: dict[str, int]
) -> None:
    @on_loop
    async def scenario() -> None:
        async with drive(tmp_path, make=make) as (_, client, _):
            assert {where: await uploaded(client, where) for where in values} == values

    scenario()


@pytest.mark.parametrize(
    ("make", "absent"),
    [
        ("maxon-epos4", "75 60 00"),
        ("elmo-gold", "a9 60 00"),
        ("nanotec", "76 60 00"),
        ("kollmorgen-akd", "76 60 00"),
    ],
)
def test_make_aborts_what_it_lacks(tmp_path: Path, make: str, absent: str) -> None:
    @on_loop
    async def scenario() -> None:
        async with drive(tmp_path, make=make) as (_, client, _):
            answer = await client.sdo(SERVO, f"40 {absent} 00 00 00 00")
            assert answer == f"80 {absent} 00 00 02 06"  # the object does not exist

    scenario()


@on_loop
async def test_mode_that_make_lacks_is_aborted(tmp_path: Path) -> None:
    async with drive(tmp_path, make="maxon-epos4") as (_, client, _):
        answer = await client.sdo(SERVO, "2f 60 60 00 04 00 00 00")
        assert answer == "80 60 60 00 30 00 09 06"  # value range


@on_loop
async def test_pulse_within_a_scan_is_not_seen(tmp_path: Path) -> None:
    async with drive(tmp_path, make="elmo-gold") as (node, client, _):
        node.inject("fault")
        await written(client, SERVO, "2b 40 60 00 00 00 00 00")
        # Three writes back to back, as fast as a master can: the reset is over before the scan.
        for word in ("80", "00"):
            client.send(0x600 + SERVO, f"2b 40 60 00 {word} 00 00 00")
        for _ in range(2):
            await client.until(0x580 + SERVO)
        assert node.state()["state"] == "fault"
        await written(client, SERVO, "2b 40 60 00 80 00 00 00")
        while node.state()["state"] == "fault":  # it holds: the next scan takes it
            await uploaded(client, "41 60 00")
        assert node.state()["state"] == "switch_on_disabled"


async def walk_up(client: Client, target: str) -> int:
    """Walk up to operation enabled, each command held until it is seen; return the statusword."""
    word = 0
    for control, state in (("06 00", 0x21), ("07 00", 0x23), ("0f 00", 0x27), ("0f 00", 0x27)):
        for _ in range(1000):
            answer = bytes.fromhex(await cycle(client, f"{control} {target}"))
            word = int.from_bytes(answer[:2], "little")
            if word & 0x6F == state:
                break
        else:
            raise AssertionError(f"the drive stays at 0x{word:04X}")
    return word


@on_loop
async def test_profile_torque_mode_leaves_bit_12_clear(tmp_path: Path) -> None:
    async with drive(tmp_path, CURRENT_DRIVE, make="kollmorgen-akd") as (_, client, physics):
        await operational(client, mode="04")
        assert await walk_up(client, "f4 01") & 0x1000 == 0
        assert physics.demands[-1].value == pytest.approx(0.5)  # 500 per mille of 1 A


@on_loop
async def test_profile_velocity_is_taken_in_own_unit(tmp_path: Path) -> None:
    async with drive(tmp_path, SPEED_DRIVE, make="elmo-gold") as (_, client, physics):
        await operational(client, mode="03")
        assert await walk_up(client, "00 10 00 00") & 0x1000  # it stands: bit 12 of this mode
        assert physics.demands[-1].value == pytest.approx(2 * 3.14159265, rel=1e-6)


def test_options_name_make_of_each_drive(tmp_path: Path) -> None:
    config = WireLugreConfig(folder=tmp_path)
    chosen = WireLugre.of_makes(config, {"": "elmo-gold", "wheel_servo": "maxon-epos4"})
    found = [chosen.wheel_servo, chosen.longitudinal_belt, chosen.lateral_belt]
    titles = [each.profile.title for each in found if each is not None and each.profile]
    assert titles == ["maxon EPOS4 Module 50/15", "Elmo Gold", "Elmo Gold"]
    for makes, said in (
        ({"": "elmo"}, "no make is called 'elmo'; there are elmo-gold, kollmorgen-akd"),
        ({"scale": "elmo-gold"}, "no drive is called 'scale'; there are wheel_servo"),
    ):
        with pytest.raises(ValueError, match=said):
            WireLugre.of_makes(config, makes)


@pytest.mark.parametrize("make", known_makes())
def test_make_is_as_hard_as_real_drives(make: str) -> None:
    traits = read_make(make)
    assert isinstance(traits, DriveTraits)
    assert (traits.boots_twice, traits.segmented, bool(traits.boot_emergencies)) == (True,) * 3
    assert traits.scan > 0
    assert len(traits.source) > 40
