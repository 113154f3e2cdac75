"""The CiA 402 drive at the wire: its state machine, what it gives the motor, how it fails safe."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from support.can.bus import Client, on_loop
from support.can.nodes import (
    SERVO,
    SPEED_DRIVE,
    SYNC,
    cycle,
    drive,
    enabled,
    operational,
    pdo,
)
from support.faults.stalls import witnessed

from rigd_sim.wire.can.drive import Sensed
from rigd_sim.wire.can.states402 import DriveState, StateMachine

S = DriveState
SHUTDOWN, SWITCH_ON, ENABLE, DISABLE_VOLTAGE, QUICK_STOP, RESET = 0x06, 0x07, 0x0F, 0, 0x02, 0x80
WATCHED = "23 16 10 01 64 00 7f 00"  # node 127 within 100 ms
DISABLE_ON_LOSS = "2b 07 60 00 02 00 00 00"
STAY_OPERATIONAL = "2f 29 10 01 01 00 00 00"
HEARTBEAT = (0x77F, "05")


@pytest.mark.parametrize(
    ("start", "command", "end"),
    [  # CiA 402-2, figure 8: the numbers are its transitions
        (S.SWITCH_ON_DISABLED, SHUTDOWN, S.READY_TO_SWITCH_ON),  # 2
        (S.READY_TO_SWITCH_ON, SWITCH_ON, S.SWITCHED_ON),  # 3
        (S.SWITCHED_ON, ENABLE, S.OPERATION_ENABLED),  # 4
        (S.READY_TO_SWITCH_ON, ENABLE, S.OPERATION_ENABLED),  # 3 and 4
        (S.OPERATION_ENABLED, SWITCH_ON, S.SWITCHED_ON),  # 5
        (S.SWITCHED_ON, SHUTDOWN, S.READY_TO_SWITCH_ON),  # 6
        (S.READY_TO_SWITCH_ON, DISABLE_VOLTAGE, S.SWITCH_ON_DISABLED),  # 7
        (S.READY_TO_SWITCH_ON, QUICK_STOP, S.SWITCH_ON_DISABLED),  # 7
        (S.OPERATION_ENABLED, SHUTDOWN, S.READY_TO_SWITCH_ON),  # 8
        (S.OPERATION_ENABLED, DISABLE_VOLTAGE, S.SWITCH_ON_DISABLED),  # 9
        (S.SWITCHED_ON, DISABLE_VOLTAGE, S.SWITCH_ON_DISABLED),  # 10
        (S.SWITCHED_ON, QUICK_STOP, S.SWITCH_ON_DISABLED),  # 10
        (S.OPERATION_ENABLED, QUICK_STOP, S.QUICK_STOP_ACTIVE),  # 11
        (S.QUICK_STOP_ACTIVE, DISABLE_VOLTAGE, S.SWITCH_ON_DISABLED),  # 12
        (S.FAULT, RESET, S.SWITCH_ON_DISABLED),  # 15
        # and what is no transition
        (S.SWITCH_ON_DISABLED, ENABLE, S.SWITCH_ON_DISABLED),
        (S.SWITCH_ON_DISABLED, SWITCH_ON, S.SWITCH_ON_DISABLED),
        (S.FAULT, SHUTDOWN, S.FAULT),
        (S.FAULT, ENABLE, S.FAULT),
        (S.QUICK_STOP_ACTIVE, SHUTDOWN, S.QUICK_STOP_ACTIVE),
    ],
)
def test_the_controlword_moves_the_state(start: DriveState, command: int, end: DriveState) -> None:
    machine = StateMachine()
    machine.state = start
    machine.control(command)
    assert machine.state is end


def test_only_a_rising_bit_7_resets_a_fault() -> None:
    machine = StateMachine()
    machine.control(RESET | SHUTDOWN)
    machine.fail()
    seen = []
    for word in (RESET | SHUTDOWN, SHUTDOWN, RESET):
        machine.control(word)
        seen.append(machine.state)
    assert seen == [S.FAULT, S.FAULT, S.SWITCH_ON_DISABLED]


@on_loop
async def test_drive_steps_up_to_enabled_and_back(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, physics):
        await operational(client)
        seen = [await cycle(client, f"{word:02x} 00 f4 01") for word in (6, 7, 15, 15, 0, 0)]
        # Bit 4 voltage, bit 9 remote, bit 12 follows its setpoint.
        assert [item[:5] for item in seen] == [
            "50 02", "31 02", "33 02", "37 12", "37 12", "50 02",
        ]  # fmt: skip
        assert [(d.value, d.powered) for d in physics.demands] == [(0.5, True), (0.0, False)]
        assert node.state()["current"] == 0.0


@on_loop
async def test_torque_is_limited_by_the_plate(tmp_path: Path) -> None:
    async with drive(tmp_path) as (_, client, physics):
        await operational(client)
        status = await enabled(client, "d0 07")  # 2000 per mille of 1 A
        assert physics.demands[-1].value == 1.5
        assert status[:5] == "37 1a"  # bit 11: internal limit active


@on_loop
async def test_drive_reports_since_when_it_is_safe(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, _):
        await operational(client)
        assert 0 < int(node.state()["safe_since_ns"]) <= time.monotonic_ns()
        await enabled(client)  # at zero torque, but it would follow
        assert node.state()["safe_since_ns"] == 0
        assert node.state()["enabled"] is True
        before = time.monotonic_ns()
        await cycle(client, "00 00 00 00")
        await client.sdo(SERVO, "40 00 10 00 00 00 00 00")
        assert before <= int(node.state()["safe_since_ns"]) <= time.monotonic_ns()


@on_loop
async def test_drive_reports_since_when_its_torque_holds(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, _):
        await operational(client)
        at_rest_ns = node.state()["given_since_ns"]
        await enabled(client)
        assert node.state()["given_since_ns"] == at_rest_ns, "still nothing"
        for target, current in (("f4 01", 0.5), ("f4 01", 0.5), ("00 00", 0.0)):
            before, was = time.monotonic_ns(), node.state()["current"]
            await cycle(client, f"0f 00 {target}")
            await cycle(client, f"0f 00 {target}")  # it acts after it has answered
            assert node.state()["current"] == current
            assert (int(node.state()["given_since_ns"]) >= before) == (was != current)


async def _alive(client: Client, *setup: str, mode: str = "0a") -> None:
    """Enable the drive with half its current or 1 turn/s, watched by heartbeats."""
    await operational(client, WATCHED, STAY_OPERATIONAL, *setup, mode=mode)
    client.send(*HEARTBEAT)
    await enabled(client, "f4 01" if mode == "0a" else "60 ea 00 00")


@on_loop
async def test_a_lost_heartbeat_takes_the_torque_away(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, physics):
        await _alive(client, DISABLE_ON_LOSS)
        with witnessed() as lost_s:
            start = time.monotonic()
            client.send(*HEARTBEAT)
            # 0x8130: communication, error register generic and communication.
            assert await client.until(0x081) == "30 81 11 00 00 00 00 00"
            assert 0.099 < time.monotonic() - start < 0.2 + lost_s()
        assert (physics.demands[-1].value, physics.demands[-1].powered) == (0.0, False)
        assert node.state()["state"] == "fault"
        assert (await cycle(client, "0f 00 f4 01"))[:5] == "18 02"  # FAULT, setpoint or not
        await cycle(client, "80 00 00 00")
        assert await client.until(0x081) == "00 00 00 00 00 00 00 00"  # no error left
        assert (await cycle(client, "00 00 00 00"))[:5] == "50 02"


@on_loop
async def test_stalled_simulation_is_not_a_lost_heartbeat(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, _):
        await _alive(client, DISABLE_ON_LOSS)
        for _ in range(150):  # more than is read at once
            client.send(0x7FF)
        client.send(*HEARTBEAT)
        time.sleep(0.15)  # the loop of the simulation: it reads nothing meanwhile
        assert await client.silent(0.05)
        assert node.state()["enabled"] is True
        assert await client.until(0x081) == "30 81 11 00 00 00 00 00"  # and then it is lost


@on_loop
async def test_node_without_heartbeats_is_not_missed(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, _):
        await operational(client, WATCHED, DISABLE_ON_LOSS)
        await enabled(client)
        assert await client.silent(0.3)
        assert node.state()["enabled"] is True


@pytest.mark.parametrize(
    ("option", "state"),
    [("00", "operation_enabled"), ("01", "fault"), ("02", "fault"), ("03", "fault")],
)
@on_loop
async def test_object_6007_sets_action_on_lost_heartbeat(
    tmp_path: Path, option: str, state: str
) -> None:
    async with drive(tmp_path) as (node, client, _):
        await _alive(client, f"2b 07 60 00 {option} 00 00 00")
        await client.until(0x081)
        if option == "03":  # it first stops, then reports the fault
            assert node.state()["state"] == "quick_stop_active"
        while node.state()["state"] != state:
            assert await client.silent(0.01)


@pytest.mark.parametrize(
    ("behaviour", "nmt"), [("00", "pre_operational"), ("01", "operational"), ("02", "stopped")]
)
@on_loop
async def test_object_1029_sets_state_after_an_error(
    tmp_path: Path, behaviour: str, nmt: str
) -> None:
    async with drive(tmp_path) as (node, client, _):
        await _alive(client, DISABLE_ON_LOSS, f"2f 29 10 01 {behaviour} 00 00 00")
        await client.until(0x081)
        assert node.state()["nmt"] == nmt
        assert node.state()["state"] == "fault"


@on_loop
async def test_late_rpdo_removes_torque_if_drive_notices(tmp_path: Path) -> None:
    async with drive(tmp_path, rpdo_timer=True) as (node, client, physics):
        await operational(client, DISABLE_ON_LOSS, "2b 00 14 05 64 00 00 00")  # 100 ms
        await enabled(client, "f4 01")
        assert await client.until(0x081) == "50 82 11 00 00 00 00 00"  # 0x8250
        assert not physics.demands[-1].powered
        assert node.state()["state"] == "fault"


@on_loop
async def test_the_epos4_has_no_rpdo_timer(tmp_path: Path) -> None:
    async with drive(tmp_path) as (_, client, _):
        refused = await client.sdo(SERVO, "2b 00 14 05 14 00 00 00")
        assert refused == "80 00 14 05 11 00 09 06"


@on_loop
async def test_drive_with_dead_watchdog_keeps_torque(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, physics):
        await _alive(client, DISABLE_ON_LOSS)
        node.inject("watchdog_dead")
        assert await client.silent(0.3)
        assert physics.demands[-1].value == 0.5


@on_loop
async def test_leaving_operational_state_switches_enabled_drive_off(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, physics):
        await operational(client, DISABLE_ON_LOSS)
        await enabled(client, "f4 01")
        client.send(0x000, "80 01")
        await client.sdo(SERVO, "40 00 10 00 00 00 00 00")
        assert not physics.demands[-1].powered
        assert node.state()["state"] == "switch_on_disabled"  # an order, not an error


@on_loop
async def test_an_emergency_means_fault_without_torque(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, physics):
        await operational(client)
        await enabled(client, "f4 01")
        node.inject("emergency", code=0x7305)
        assert await client.until(0x081) == "05 73 01 00 00 00 00 00"
        assert not physics.demands[-1].powered
        assert (await cycle(client, "0f 00 f4 01"))[:5] == "18 02"
        assert node.state()["error_code"] == 0x7305


@on_loop
async def test_fault_without_word_shows_in_statusword_alone(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, physics):
        await operational(client)
        await enabled(client, "f4 01")
        node.inject("fault")
        client.send(*SYNC)
        assert (await client.receive())[1][:5] == "18 02"
        assert not physics.demands[-1].powered


@on_loop
async def test_drive_ignoring_its_setpoint_sets_bits_9_12(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, physics):
        await operational(client)
        await enabled(client, "f4 01")
        node.inject("setpoint_ignored")
        assert (await cycle(client, "0f 00 f4 01"))[:5] == "37 00"
        assert physics.demands[-1].value == 0.0
        node.clear("setpoint_ignored")
        assert physics.demands[-1].value == 0.5


@on_loop
async def test_stuck_drive_goes_on_until_it_is_cleared(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, physics):
        await operational(client)
        await enabled(client, "f4 01")
        node.inject("stuck")
        assert (await cycle(client, "00 00 00 00"))[:5] == "37 12"
        node.connection_lost(0, 0x8130)
        assert physics.demands[-1].value == 0.5
        assert node.state()["safe_since_ns"] == 0
        node.clear("stuck")
        assert not physics.demands[-1].powered


@on_loop
async def test_locked_drive_is_not_enabled(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, physics):
        await operational(client)
        await enabled(client, "f4 01")
        node.inject("locked")
        assert not physics.demands[-1].powered
        for word in ("06", "07", "0f", "0f"):
            status = await cycle(client, f"{word} 00 f4 01")
        assert status[:5] != "37 12"
        assert not physics.demands[-1].powered


@on_loop
async def test_blocked_drive_gives_torque_and_stands(tmp_path: Path) -> None:
    async with drive(tmp_path) as (node, client, physics):
        await operational(client)
        await enabled(client, "f4 01")
        node.inject("blocked")
        assert physics.demands[-1].value == 0.0
        assert node.state()["current"] == 0.5
        physics.sensed = Sensed(999, 5.0, 0.0)  # what it drove runs on without it
        node.sample(0)
        measured = [node.dictionary.find(index, 0).value for index in (0x6064, 0x606C, 0x6078)]
        assert measured == [0, 0, 500]
        node.clear("blocked")
        assert physics.demands[-1].value == 0.5


@pytest.mark.parametrize(("option", "state"), [("02", "switch_on_disabled"), ("06", None)])
@on_loop
async def test_a_speed_drive_brakes_in_a_quick_stop(
    tmp_path: Path, option: str, state: str | None
) -> None:
    async with drive(tmp_path, SPEED_DRIVE) as (node, client, physics):
        await operational(client, f"2b 5a 60 00 {option} 00 00 00", mode="09")
        await enabled(client, "60 ea 00 00")  # 60000 mrpm: a turn per second
        assert physics.demands[-1].value == pytest.approx(6.2832, abs=1e-4)
        assert node.state()["speed"] == pytest.approx(6.2832 * 0.02, abs=1e-5)
        physics.sensed = Sensed(0, 6.28, 0.0)
        await cycle(client, "02 00 60 ea 00 00")
        status = await cycle(client, "02 00 60 ea 00 00")
        assert status[:5] == "17 02"
        assert (physics.demands[-1].value, physics.demands[-1].powered) == (0.0, True)
        physics.sensed = Sensed(0, 0.0, 0.0)
        if state is None:
            assert await client.silent()
            assert node.state()["state"] == "quick_stop_active"
        else:
            while node.state()["state"] == "quick_stop_active":
                await cycle(client, "02 00 60 ea 00 00")
            assert node.state()["state"] == state
            assert not physics.demands[-1].powered


@on_loop
async def test_a_speed_drive_without_power_engages_its_clutch(tmp_path: Path) -> None:
    async with drive(tmp_path, SPEED_DRIVE) as (_, client, physics):
        await _alive(
            client,
            DISABLE_ON_LOSS,
            *pdo(2, SERVO, "2001fe60", receive=True, kind="ff"),
            mode="09",
        )
        client.send(0x301, "00 00 01 00")
        await cycle(client, "0f 00 60 ea 00 00")
        assert physics.demands[-1].released
        await client.until(0x081)  # the heartbeat is lost
        assert not physics.demands[-1].released
        assert not physics.demands[-1].powered


@on_loop
async def test_sdo_read_measures_at_that_time(tmp_path: Path) -> None:
    async with drive(tmp_path) as (_, client, physics):
        physics.sensed = Sensed(513, 0.0, 0.0)
        assert await client.sdo(SERVO, "40 64 60 00 00 00 00 00") == "43 64 60 00 01 02 00 00"


@on_loop
async def test_velocity_is_in_thousandths_of_turn_per_minute(tmp_path: Path) -> None:
    async with drive(tmp_path, SPEED_DRIVE) as (_, client, physics):
        await operational(client, *pdo(2, SERVO, "20006c60"), mode="09")
        physics.sensed = Sensed(0, -2 * 3.141592653589793, 0.0)  # a turn per second
        client.send(*SYNC)
        assert await client.until(0x281) == "a0 15 ff ff"  # -60000
