"""The CiA 406 encoder at the wire."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.can.bus import Client, on_loop
from support.can.nodes import ENCODER, SYNC, encoder, pdo, written

from rigd_sim.wire.can.encoder import Scale

SCALE = Scale(counts_per_turn=1024, turns=64, start=10)


async def _position(client: Client) -> str:
    client.send(*SYNC)
    return await client.until(0x180 + ENCODER)


async def _running(client: Client) -> None:
    await written(client, ENCODER, *pdo(1, ENCODER, "20000460"))
    client.send(0x000, "01 00")


@on_loop
async def test_encoder_reports_its_identity(tmp_path: Path) -> None:
    golden = {
        "40 00 10 00 00 00 00 00": "43 00 10 00 96 01 02 00",  # profile 406, many turns
        "40 00 60 00 00 00 00 00": "4b 00 60 00 04 00 00 00",  # scaling is on
        "40 00 65 00 00 00 00 00": "4b 00 65 00 04 00 00 00",
        "40 01 60 00 00 00 00 00": "43 01 60 00 00 04 00 00",  # units per turn
        "40 02 60 00 00 00 00 00": "43 02 60 00 00 00 01 00",  # range: 65536 units
        "40 01 65 00 00 00 00 00": "43 01 65 00 00 00 01 00",  # its own steps per turn
        "40 02 65 00 00 00 00 00": "4b 02 65 00 40 00 00 00",  # turns
        "40 04 60 00 00 00 00 00": "43 04 60 00 0a 00 00 00",  # position
    }
    async with encoder(tmp_path, SCALE) as (_, client, _):
        for request, answer in golden.items():
            assert await client.sdo(ENCODER, request) == answer


@on_loop
async def test_position_rolls_over_at_end_of_its_turns(tmp_path: Path) -> None:
    async with encoder(tmp_path, SCALE) as (_, client, physics):
        await _running(client)
        assert await _position(client) == "0a 00 00 00"
        physics.counts = -11.0
        assert await _position(client) == "ff ff 00 00"  # 65536 positions
        physics.counts = 65536.0
        assert await _position(client) == "0a 00 00 00"


@on_loop
async def test_scaling_sets_units_and_range(tmp_path: Path) -> None:
    async with encoder(tmp_path, SCALE) as (_, client, physics):
        await _running(client)
        physics.counts = 512.0 - 10.0  # half a turn
        await written(client, ENCODER, "23 01 60 00 68 01 00 00")  # 360 units per turn
        assert await _position(client) == "b4 00 00 00"
        await written(client, ENCODER, "23 02 60 00 b3 00 00 00")  # after 179 units again
        assert await _position(client) == "01 00 00 00"
        await written(client, ENCODER, "2b 00 60 00 00 00 00 00")  # off: 65536 steps per turn
        assert await _position(client) == "00 80 00 00"
        assert await client.sdo(ENCODER, "40 00 65 00 00 00 00 00") == "4b 00 65 00 00 00 00 00"


@on_loop
async def test_encoder_shows_jump_and_sign_faults(tmp_path: Path) -> None:
    async with encoder(tmp_path, SCALE) as (node, client, physics):
        await _running(client)
        node.inject("jump", counts=-10)
        assert await _position(client) == "00 00 00 00"
        node.inject("sign_flip")
        physics.counts = -256.0
        assert await _position(client) == "00 01 00 00"
        node.clear("sign_flip")
        node.inject("missed_counts", fraction=0.5)
        physics.counts += 2
        assert await _position(client) == "01 01 00 00"
        node.clear()
        node.inject("index_reset")
        physics.counts += 1
        assert await _position(client) == "01 00 00 00"
        assert node.state()["faults"] == ""
        with pytest.raises(ValueError, match="'counts' is missing"):
            node.inject("jump")


@on_loop
async def test_observer_reads_the_true_state(tmp_path: Path) -> None:
    scale = Scale(1024, 64, start=10, measure="position", per_count=0.5)
    async with encoder(tmp_path, scale) as (node, client, physics):
        await _running(client)
        physics.counts = 4.0
        assert await _position(client) == "0e 00 00 00"
        node.inject("jump", counts=100)
        assert node.state()["position"] == 2.0


@on_loop
async def test_preset_value_becomes_the_position(tmp_path: Path) -> None:
    async with encoder(tmp_path, SCALE) as (_, client, physics):
        await _running(client)
        physics.counts = 100.0
        assert await _position(client) == "6e 00 00 00"  # it began at 10
        await written(client, ENCODER, "23 03 60 00 e8 03 00 00")
        assert await _position(client) == "e8 03 00 00"
        physics.counts = 102.0
        assert await _position(client) == "ea 03 00 00"
