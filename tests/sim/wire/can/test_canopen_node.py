"""CANopen nodes at the wire: NMT, SDO, PDO, heartbeats, emergencies, to the byte (CiA 301)."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from support.can.bus import Client, on_loop
from support.can.nodes import (
    FEEDBACK,
    OPERATIONAL,
    SERVO,
    SYNC,
    cycle,
    drive,
    enabled,
    operational,
    pdo,
    written,
)
from support.faults.stalls import witnessed

from rigd_sim.wire.can.drive import Sensed


@on_loop
async def test_objects_are_read_expedited(tmp_path: Path) -> None:
    # CiA 301, 7.2.4.3.6: 4 - n bytes of data, n in bits 2 and 3 of the answer's first byte.
    golden = {
        "40 00 10 00 00 00 00 00": "43 00 10 00 92 01 02 00",  # device type 402, servo
        "40 01 10 00 00 00 00 00": "4f 01 10 00 00 00 00 00",  # error register
        "40 17 10 00 00 00 00 00": "4b 17 10 00 00 00 00 00",  # heartbeat time
        "40 18 10 04 00 00 00 00": "43 18 10 04 34 12 00 00",  # serial number
        "40 18 10 00 00 00 00 00": "4f 18 10 00 04 00 00 00",  # number of entries
        "40 14 10 00 00 00 00 00": "43 14 10 00 81 00 00 00",  # COB-ID of emergencies
        "40 76 60 00 00 00 00 00": "43 76 60 00 32 00 00 00",  # rated torque 50 mN m
        "40 75 60 00 00 00 00 00": "43 75 60 00 e8 03 00 00",  # rated current 1000 mA
        "40 73 60 00 00 00 00 00": "4b 73 60 00 dc 05 00 00",  # largest current: 1500 per mille
        "40 02 65 00 00 00 00 00": "43 02 65 00 00 02 00 00",  # supported modes: CST alone
        "40 a9 60 00 00 00 00 00": "43 a9 60 00 00 47 b4 fd",  # velocity in 0.001 1/min
        "40 07 60 00 00 00 00 00": "4b 07 60 00 03 00 00 00",  # abort connection: quick stop
    }
    async with drive(tmp_path) as (_, client, _):
        for request, answer in golden.items():
            assert await client.sdo(SERVO, request) == answer


@on_loop
async def test_text_is_read_in_segments_with_toggle(tmp_path: Path) -> None:
    async with drive(tmp_path) as (_, client, _):
        begin = await client.sdo(SERVO, "40 08 10 00 00 00 00 00")
        assert begin == "41 08 10 00 14 00 00 00"  # 20 bytes follow
        segments = [
            await client.sdo(SERVO, f"{0x60 | toggle << 4:02x}" + "00" * 7) for toggle in (0, 1, 0)
        ]
        # Toggle in bit 4, unused bytes in bits 1 to 3, bit 0 in the last one.
        assert [segment[:2] for segment in segments] == ["00", "10", "03"]
        text = b"".join(bytes.fromhex(segment)[1:] for segment in segments)
        assert text == b"rigd simulated servo\0"
        again = await client.sdo(SERVO, "60" + "00" * 7)
        assert again == "80 00 00 00 01 00 04 05"  # nothing is under way


@on_loop
async def test_wrong_toggle_of_client_ends_transfer(tmp_path: Path) -> None:
    async with drive(tmp_path) as (_, client, _):
        await client.sdo(SERVO, "40 08 10 00 00 00 00 00")
        assert await client.sdo(SERVO, "70" + "00" * 7) == "80 08 10 00 00 00 03 05"


@on_loop
async def test_a_value_is_written_in_segments(tmp_path: Path) -> None:
    async with drive(tmp_path) as (_, client, _):
        # 1016:1 (u32): heartbeat of node 127 within 100 ms, as one segment of 4 bytes.
        assert await client.sdo(SERVO, "21 16 10 01 04 00 00 00") == "60 16 10 01 00 00 00 00"
        assert await client.sdo(SERVO, "07 64 00 7f 00 00 00 00") == "20" + " 00" * 7
        assert await client.sdo(SERVO, "40 16 10 01 00 00 00 00") == "43 16 10 01 64 00 7f 00"


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("40 00 20 00 00 00 00 00", "80 00 20 00 00 00 02 06"),  # no such object
        ("40 18 10 09 00 00 00 00", "80 18 10 09 11 00 09 06"),  # no such sub-index
        ("2b 41 60 00 00 00 00 00", "80 41 60 00 02 00 01 06"),  # read only
        ("2b 07 60 00 09 00 00 00", "80 07 60 00 30 00 09 06"),  # value range
        ("2f 60 60 00 09 00 00 00", "80 60 60 00 30 00 09 06"),  # mode that it does not have
        ("2f 07 60 00 02 00 00 00", "80 07 60 00 13 00 07 06"),  # too short
        ("23 07 60 00 02 00 00 00", "80 07 60 00 12 00 07 06"),  # too long
        ("c0 00 10 00 00 00 00 00", "80 00 10 00 01 00 04 05"),  # block transfer
        ("2f 02 18 02 f1 00 00 00", "80 02 18 02 30 00 09 06"),  # reserved transmission type
        ("23 00 1a 01 10 09 18 10", "80 00 1a 01 11 00 09 06"),  # maps a sub-index it has not
        ("23 00 1a 01 20 00 41 60", "80 00 1a 01 41 00 04 06"),  # 6041 has 16 bits, not 32
        ("23 00 1a 01 20 00 00 10", "80 00 1a 01 41 00 04 06"),  # 1000 cannot be mapped
    ],
)
@on_loop
async def test_invalid_access_is_aborted(tmp_path: Path, request_: str, answer: str) -> None:
    async with drive(tmp_path) as (_, client, _):
        assert await client.sdo(SERVO, request_) == answer


@on_loop
async def test_mapping_changes_only_while_pdo_is_disabled_empty(tmp_path: Path) -> None:
    state = "22 00 00 08"
    async with drive(tmp_path) as (_, client, _):
        await written(client, SERVO, *pdo(1, SERVO, *FEEDBACK))
        assert (await client.sdo(SERVO, "2f 00 1a 00 00 00 00 00")).endswith(state)
        assert (await client.sdo(SERVO, "23 00 1a 01 20 00 64 60")).endswith(state)
        value = "30 00 09 06"  # another COB-id, an inhibit time
        assert (await client.sdo(SERVO, "23 00 18 01 82 01 00 00")).endswith(value)
        assert (await client.sdo(SERVO, "23 00 18 01 82 01 00 80")).endswith(value)
        assert (await client.sdo(SERVO, "2b 00 18 03 00 00 00 00")).endswith(value)
        await written(client, SERVO, "23 00 18 01 81 01 00 80")  # disabled: not yet empty
        assert (await client.sdo(SERVO, "23 00 1a 01 20 00 64 60")).endswith(state)
        await written(client, SERVO, "2f 00 1a 00 00 00 00 00", "23 00 1a 01 20 00 64 60")


@on_loop
async def test_an_empty_pdo_cannot_be_enabled(tmp_path: Path) -> None:
    async with drive(tmp_path) as (_, client, _):
        answer = await client.sdo(SERVO, "23 00 18 01 81 01 00 00")
        assert answer == "80 00 18 01 30 00 09 06"


@on_loop
async def test_node_that_misses_heartbeats_refuses_start(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, _):
        await operational(client, "23 16 10 01 32 00 7f 00")  # node 127 within 50 ms
        client.send(0x77F, "05")
        assert await client.until(0x081) == "30 81 11 00 00 00 00 00"
        client.send(*OPERATIONAL)
        await client.sdo(SERVO, "40 00 10 00 00 00 00 00")
        assert node.state()["nmt"] == "pre_operational"
        client.send(0x77F, "05")
        client.send(*OPERATIONAL)
        await client.sdo(SERVO, "40 00 10 00 00 00 00 00")
        assert node.state()["nmt"] == "operational"


@on_loop
async def test_a_mapping_longer_than_eight_bytes_is_refused(tmp_path: Path) -> None:
    async with drive(tmp_path) as (_, client, _):
        *setup, _, _, _, _ = pdo(1, SERVO, *FEEDBACK, "10004060")
        await written(client, SERVO, *setup)
        answer = await client.sdo(SERVO, "2f 00 1a 00 04 00 00 00")
        assert answer == "80 00 1a 00 42 00 04 06"


@on_loop
async def test_heartbeats_follow_the_nmt_state(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, _):
        await written(client, SERVO, "2b 17 10 00 0a 00 00 00")  # every 10 ms
        assert await client.until(0x701) == "7f"
        for command, state in (("01 01", "05"), ("02 00", "04"), ("80 01", "7f")):
            client.send(0x000, command)
            while await client.until(0x701) != state:
                pass
        client.send(0x000, "01 02")  # another node is meant
        assert await client.until(0x701) == "7f"
        assert node.state()["nmt"] == "pre_operational"


@on_loop
async def test_heartbeats_keep_their_period(tmp_path: Path) -> None:
    async with drive(tmp_path) as (_, client, _):
        await written(client, SERVO, "2b 17 10 00 14 00 00 00")
        await client.until(0x701)
        with witnessed() as lost_s:
            start = time.monotonic()
            for _ in range(10):
                await client.until(0x701)
            took_s = time.monotonic() - start
            assert 0.19 - lost_s() < took_s < 0.25 + lost_s()  # 0.2 s


@on_loop
async def test_a_stopped_node_answers_no_sdo(tmp_path: Path) -> None:
    async with drive(tmp_path) as (_, client, _):
        client.send(0x000, "02 01")
        client.send(0x601, "40 00 10 00 00 00 00 00")
        assert await client.silent()


@pytest.mark.parametrize(("command", "kept"), [("81 01", "00"), ("82 01", "02")])
@on_loop
async def test_reset_reboots_and_loses_the_configuration(
    tmp_path: Path, command: str, kept: str
) -> None:
    async with drive(tmp_path) as (_, client, _):
        await operational(client, "2b 07 60 00 02 00 00 00")
        client.send(0x000, command)
        assert await client.receive() == (0x701, "00")
        client.send(*OPERATIONAL)
        client.send(*SYNC)
        assert await client.silent()  # no mapping any more
        assert (await client.sdo(SERVO, "40 00 1a 00 00 00 00 00"))[12:14] == "00"
        # A reset of the communication leaves the rest as it was (CiA 301, 7.3.2.2.1).
        restored = "03" if kept == "00" else kept
        assert (await client.sdo(SERVO, "40 07 60 00 00 00 00 00"))[12:14] == restored


@on_loop
async def test_synchronous_tpdo_answers_every_sync_with_measured_value(tmp_path: Path) -> None:
    async with drive(tmp_path) as (_, client, physics):
        await operational(client)
        physics.sensed = Sensed(-2, 0.0, -0.025)
        client.send(*SYNC)
        # switch on disabled with voltage and remote; -500 per mille; -2 counts
        assert await client.receive() == (0x181, "50 02 0c fe fe ff ff ff")
        physics.sensed = Sensed(2**31, 0.0, 10.0)  # the counter wraps, the torque is clipped
        client.send(*SYNC)
        assert await client.receive() == (0x181, "50 02 ff 7f 00 00 00 80")
        assert await client.silent()  # once for each SYNC


@on_loop
async def test_a_tpdo_may_answer_every_second_sync_only(tmp_path: Path) -> None:
    async with drive(tmp_path) as (_, client, _):
        await written(client, SERVO, *pdo(1, SERVO, "10004160", kind="02"))
        client.send(*OPERATIONAL)
        for _ in range(4):
            client.send(*SYNC)
        assert await client.frames(2) == [(0x181, "50 02")] * 2
        assert await client.silent()


@on_loop
async def test_event_driven_tpdo_comes_when_its_values_change(tmp_path: Path) -> None:
    async with drive(tmp_path) as (_, client, _):
        await written(client, SERVO, *pdo(1, SERVO, "10004160", kind="ff"))
        client.send(*OPERATIONAL)
        await written(client, SERVO, "2b 40 60 00 06 00 00 00")  # shutdown
        assert await client.receive() == (0x181, "31 02")
        client.send(*SYNC)
        assert await client.silent()


@on_loop
async def test_an_inhibit_time_holds_tpdos_back(tmp_path: Path) -> None:
    async with drive(tmp_path) as (_, client, _):
        # 1 s, in units of 0.1 ms
        await written(client, SERVO, *pdo(1, SERVO, *FEEDBACK, inhibit="10 27"))
        client.send(*OPERATIONAL)
        for _ in range(3):
            client.send(*SYNC)
        assert (await client.receive())[0] == 0x181
        assert await client.silent()


@on_loop
async def test_rpdos_act_at_sync_or_at_once(tmp_path: Path) -> None:
    async with drive(tmp_path) as (_, client, physics):
        await operational(client, *pdo(2, SERVO, "2001fe60", receive=True, kind="ff"))
        await enabled(client, "f4 01")
        assert physics.demands[-1].value == 0.5  # 500 per mille of 1 A
        client.send(0x201, "0f 00 c8 00")  # 200 per mille: waits for SYNC
        client.send(0x301, "00 00 01 00")  # bit 16: at once
        await client.sdo(SERVO, "40 00 10 00 00 00 00 00")
        assert (physics.demands[-1].value, physics.demands[-1].released) == (0.5, True)
        client.send(*SYNC)
        await client.until(0x181)
        assert physics.demands[-1].value == 0.2


@on_loop
async def test_rpdo_too_short_is_emergency_and_changes_nothing(tmp_path: Path) -> None:
    async with drive(tmp_path) as (_, client, physics):
        await operational(client)
        await enabled(client, "64 00")
        client.send(0x201, "0f 00 ff")
        assert await client.until(0x081) == "10 82 11 00 00 00 00 00"  # 0x8210
        client.send(*SYNC)
        await client.until(0x181)
        assert physics.demands[-1].value == 0.1


@on_loop
async def test_errors_are_remembered_newest_first_until_forgotten(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, _):
        node.inject("emergency", code=0x2310)
        assert await client.receive() == (0x081, "10 23 03 00 00 00 00 00")
        node.inject("emergency", code=0x3220)
        assert await client.receive() == (0x081, "20 32 07 00 00 00 00 00")
        read = ["40 03 10 00", "40 03 10 01", "40 03 10 02", "40 01 10 00", "40 3f 60 00"]
        answers = [await client.sdo(SERVO, f"{item} 00 00 00 00") for item in read]
        assert [answer[12:] for answer in answers] == [
            "02 00 00 00", "20 32 00 00", "10 23 00 00", "07 00 00 00", "20 32 00 00",
        ]  # fmt: skip
        assert await client.sdo(SERVO, "2f 03 10 00 01 00 00 00") == "80 03 10 00 30 00 09 06"
        await written(client, SERVO, "2f 03 10 00 00 00 00 00")
        assert (await client.sdo(SERVO, "40 03 10 01 00 00 00 00"))[12:] == "00 00 00 00"
        await written(client, SERVO, "2b 40 60 00 80 00 00 00")  # fault reset
        assert await client.sdo(SERVO, "40 01 10 00 00 00 00 00") == "4f 01 10 00 00 00 00 00"


async def _fresh(client: Client) -> str:
    """Return the first TPDO after what is on its way."""
    return await cycle(client, "00 00 00 00")


@pytest.mark.parametrize(
    ("fault", "options", "expected"),
    [
        ("tpdo_short", {}, [(0x181, "50 02 00 00 00 00 00")]),
        ("tpdo_duplicate", {}, [(0x181, "50 02 00 00 00 00 00 00")] * 2),
        ("tpdo_wrong_id", {"id": 0x191}, [(0x191, "50 02 00 00 00 00 00 00")]),
        ("tpdo_missing", {}, []),
        ("tpdo_missing", {"number": 2}, [(0x181, "50 02 00 00 00 00 00 00")]),
    ],
)
@on_loop
async def test_faulty_tpdos_are_sent_as_listed(
    tmp_path: Path, fault: str, options: dict[str, int], expected: list[tuple[int, str]]
) -> None:
    async with drive(tmp_path) as (node, client, _):
        await operational(client)
        await client.sdo(SERVO, "40 00 10 00 00 00 00 00")
        node.inject(fault, **options)
        client.send(*SYNC)
        assert await client.frames(len(expected)) == expected
        assert await client.silent()
        node.clear(fault)
        assert await _fresh(client) == "50 02 00 00 00 00 00 00"


@on_loop
async def test_stale_tpdos_repeat_themselves_while_node_is_alive(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, physics):
        await operational(client)
        node.inject("tpdo_stale")
        first = await _fresh(client)
        physics.sensed = Sensed(77, 0.0, 0.0)
        assert await _fresh(client) == first
        node.clear()
        assert await _fresh(client) == "50 02 00 00 4d 00 00 00"


@on_loop
async def test_sdo_fault_changes_the_answer(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, _):
        read = "40 00 10 00 00 00 00 00"
        node.inject("sdo_abort", code=0x06020000, index=0x1000)
        assert await client.sdo(SERVO, read) == "80 00 10 00 00 00 02 06"
        assert (await client.sdo(SERVO, "40 01 10 00 00 00 00 00"))[:2] == "4f"
        node.clear()
        node.inject("sdo_wrong_toggle")
        await client.sdo(SERVO, "40 08 10 00 00 00 00 00")
        assert (await client.sdo(SERVO, "60" + "00" * 7))[:2] == "10"
        node.clear()
        node.inject("mapping_refused")
        assert (await client.sdo(SERVO, "2f 00 1a 00 00 00 00 00"))[:2] == "80"
        node.inject("sdo_silent")
        client.send(0x601, read)
        assert await client.silent()


@on_loop
async def test_slow_node_sends_everything_late(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, _):
        node.inject("slow", delay_s=0.05)
        start = time.monotonic()
        assert await client.sdo(SERVO, "40 00 10 00 00 00 00 00")
        assert time.monotonic() - start >= 0.05


@on_loop
async def test_node_without_supply_is_silent_and_boots_later(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, physics):
        await operational(client)
        await enabled(client, "64 00")
        node.inject("silent")
        assert not physics.demands[-1].powered
        client.send(0x601, "40 00 10 00 00 00 00 00")
        client.send(*SYNC)
        assert await client.silent()
        node.clear("silent")
        assert await client.receive() == (0x701, "00")


@on_loop
async def test_twin_fault_boots_and_answers_too(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, _):
        node.inject("twin")
        assert await client.receive() == (0x701, "00")
        client.send(0x601, "40 18 10 04 00 00 00 00")
        answers = {data for _, data in await client.frames(2)}
        assert answers == {"43 18 10 04 34 12 00 00", "43 18 10 04 35 12 00 00"}
        node.clear("twin")
        client.send(0x601, "40 18 10 04 00 00 00 00")
        assert await client.receive() == (0x581, "43 18 10 04 34 12 00 00")
        assert await client.silent()


@on_loop
async def test_every_fault_of_every_node_shows_and_clears(tmp_path: Path) -> None:
    needed: dict[str, dict[str, float]] = {
        "emergency": {"code": 0x2310},
        "slow": {"delay_s": 0.001},
    }
    async with drive(tmp_path) as (node, client, _):
        for fault in node.faults:
            node.inject(fault, **needed.get(fault, {}))
            client.send(*SYNC)
        node.clear()
        assert node.state()["faults"] == ""
        assert await client.until(0x701) == "00"
        answer = await client.sdo(SERVO, "40 00 10 00 00 00 00 00")
        assert answer == "43 00 10 00 92 01 02 00"


@on_loop
async def test_reset_amid_run_takes_torque_away(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, physics):
        await operational(client)
        await enabled(client, "64 00")
        node.inject("reset")
        assert not physics.demands[-1].powered
        assert await client.until(0x701) == "00"
        assert node.state()["state"] == "switch_on_disabled"


@pytest.mark.parametrize(
    ("fault", "options", "words"),
    [
        ("explode", {}, "servo has no fault 'explode'.*tpdo_stale"),
        ("emergency", {}, "'code' is missing"),
        ("slow", {"delay_s": -1}, "'delay_s' is -1, expected 0 to 10"),
        ("reset", {"now": True}, "takes no option now"),
    ],
)
@on_loop
async def test_faults_that_cannot_be_shown_are_refused(
    tmp_path: Path, fault: str, options: dict[str, object], words: str
) -> None:
    async with drive(tmp_path) as (node, _, _):
        with pytest.raises(ValueError, match=words):
            node.inject(fault, **options)
        assert node.state()["faults"] == ""
