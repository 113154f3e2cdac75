"""The CAN bus between processes: delivery, its order, and the effect of faults."""

from __future__ import annotations

import asyncio
import errno
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from support.can.bus import Client, on_loop, run

from rigd_sim.wire.can.hub import CanHub
from rigd_sim.wire.can.timing import Arbiter, frame_ns

BUS_OFF = 0x20000040  # CAN_ERR_FLAG | CAN_ERR_BUSOFF, linux/can/error.h
RESTARTED = 0x20000100
PROTOCOL_ERROR = 0x20000008


@asynccontextmanager
async def bus(
    folder: Path, clients: int, *, bitrate: float | None = None
) -> AsyncIterator[tuple[CanHub, list[Client]]]:
    hub = CanHub("bus", folder / "bus", bitrate=bitrate, seed=1)
    await hub.start()
    connected = [Client(folder / "bus") for _ in range(clients)]
    while hub.state()["clients"] != clients:
        await asyncio.sleep(0)
    try:
        yield hub, connected
    finally:
        for client in connected:
            client.close()
        await hub.stop()


@on_loop
async def test_frame_reaches_all_but_its_sender(tmp_path: Path) -> None:
    async with bus(tmp_path, 3) as (_, (a, b, c)):
        a.send(0x123, "01 02 03")
        a.send(0x9ABCDEF0, "")  # flags of extended frames pass unchanged
        for other in (b, c):
            assert await other.frames(2) == [(0x123, "01 02 03"), (0x9ABCDEF0, "")]
        assert await a.silent()


@on_loop
async def test_every_client_sees_same_order_including_answers(tmp_path: Path) -> None:
    async with bus(tmp_path, 2) as (hub, (a, b)):
        first = hub.attach(lambda can_id, data, t_ns: first.send(0x181, b"\1"))
        second = hub.attach(lambda can_id, data, t_ns: second.send(0x182, b"\2"))
        first.listen([0x080])
        second.listen([0x080, 0x181])
        a.send(0x080)
        seen = await b.frames(4)
        assert seen == [(0x080, ""), (0x181, "01"), (0x182, "02"), (0x182, "02")]
        assert await a.frames(3) == seen[1:]


@on_loop
async def test_node_receives_only_subscribed_frames_until_detached(tmp_path: Path) -> None:
    async with bus(tmp_path, 2) as (hub, (a, b)):
        heard: list[int] = []
        port = hub.attach(lambda can_id, data, t_ns: heard.append(can_id))
        port.listen([0x10])
        a.send(0x10)
        a.send(0x11)
        await b.frames(2)
        port.detach()
        port.detach()
        a.send(0x10)
        await b.frames(1)
        assert heard == [0x10]


@on_loop
async def test_client_without_reads_loses_only_own_frames(tmp_path: Path) -> None:
    async with bus(tmp_path, 3) as (hub, (a, b, stopped)):
        for number in range(3000):
            a.send(number % 0x7FF)
            assert (await b.receive())[0] == number % 0x7FF
        lost = int(hub.state()["lost"])
        assert 0 < lost < 3000
        assert hub.state()["frames"] == 3000
        assert (await stopped.receive())[0] == 0  # what came first is kept


@on_loop
async def test_disconnected_client_is_forgotten(tmp_path: Path) -> None:
    async with bus(tmp_path, 2) as (hub, (a, b)):
        a.send(0x1)
        await b.receive()
        b.close()
        a.send(0x2)
        while hub.state()["clients"] != 1:
            await asyncio.sleep(0)
        c = Client(tmp_path / "bus")
        while hub.state()["clients"] != 2:
            await asyncio.sleep(0)
        a.send(0x3)
        assert await c.receive() == (0x3, "")
        c.close()


@on_loop
async def test_invalid_packets_are_counted_and_not_relayed(tmp_path: Path) -> None:
    async with bus(tmp_path, 2) as (hub, (a, b)):
        a.socket.send(b"hello")
        a.socket.send(bytes(17))
        a.socket.send(b"\1\0\0\0\x09" + bytes(11))  # nine bytes of data
        a.send(BUS_OFF, "00" * 8)  # no client can send an error frame
        a.send(0x7, "aa")
        assert await b.receive() == (0x7, "aa")
        assert hub.state()["malformed"] == 4


@on_loop
async def test_a_taken_name_is_refused(tmp_path: Path) -> None:
    async with bus(tmp_path, 0):
        with pytest.raises(OSError) as refused:
            await CanHub("other", tmp_path / "bus").start()
        assert refused.value.errno == errno.EADDRINUSE
    assert not (tmp_path / "bus").exists()


def test_frame_time_follows_from_its_bits() -> None:
    # 47 bits + 64 of data + at most 24 stuffed at 1 Mbit/s (ISO 11898-1).
    assert frame_ns(8, 1e6) == 135_000
    assert frame_ns(0, 1e6) == 55_000
    assert frame_ns(0, 125e3) == 8 * 55_000


def test_the_lowest_identifier_wins_among_those_that_wait() -> None:
    arbiter = Arbiter(1e6)
    for can_id in (0x700, 0x300, 0x080, 0x300):
        arbiter.offer((can_id, can_id, b""), 1000)
    taken = []
    t_ns = 1000
    for _ in range(4):
        assert arbiter.take(t_ns + 54_999) is None
        t_ns += 55_000
        frame = arbiter.take(t_ns)
        assert frame is not None
        taken.append(frame[1])
        arbiter.resume()
    # The first had the bus for itself when it began; no other takes it away.
    assert taken == [0x700, 0x080, 0x300, 0x300]
    assert arbiter.due_ns is None
    assert arbiter.busy_ns == 220_000


@on_loop
async def test_frames_are_no_faster_than_the_bitrate(tmp_path: Path) -> None:
    async with bus(tmp_path, 2, bitrate=10e3) as (hub, (a, b)):
        start = time.monotonic()
        for can_id in (0x300, 0x200, 0x100):
            a.send(can_id)
        order = [(await b.receive())[0] for _ in range(3)]
        assert time.monotonic() - start >= 3 * 5.5e-3
        assert order == [0x300, 0x100, 0x200]
        assert 0 < float(hub.state()["load"]) <= 1


@on_loop
async def test_drop_and_duplicate_faults_change_the_frames(tmp_path: Path) -> None:
    async with bus(tmp_path, 2) as (hub, (a, b)):
        hub.inject("drop", id=0x10)
        hub.inject("duplicate", id=0x11)
        for can_id in (0x10, 0x11, 0x12):
            a.send(can_id)
        assert [f[0] for f in await b.frames(3)] == [0x11, 0x11, 0x12]
        assert hub.state()["faults"] == "drop duplicate"
        hub.clear("drop")
        a.send(0x10)
        assert await b.receive() == (0x10, "")
        hub.clear()
        a.send(0x11)
        assert await b.receive() == (0x11, "")
        assert await b.silent()


def test_some_frames_are_dropped_by_chance(tmp_path: Path) -> None:
    async def scenario() -> int:
        async with bus(tmp_path, 2) as (hub, (a, b)):
            hub.inject("drop", probability=0.3, id=0x10)
            for _ in range(200):
                a.send(0x10)
            a.send(0x11)
            count = 0
            while (await b.receive())[0] == 0x10:
                count += 1
            return count

    counts = {run(scenario()) for _ in range(2)}
    assert len(counts) == 1  # a seed repeats
    assert 110 < counts.pop() < 170


@on_loop
async def test_delayed_frames_keep_order_and_reordered_do_not(tmp_path: Path) -> None:
    async with bus(tmp_path, 2) as (hub, (a, b)):
        hub.inject("delay", delay_s=0.02, jitter_s=0.01)
        start = time.monotonic()
        for can_id in range(10):
            a.send(can_id)
        assert [f[0] for f in await b.frames(10)] == list(range(10))
        assert time.monotonic() - start >= 0.02
        hub.clear()
        hub.inject("reorder")
        for can_id in range(4):
            a.send(can_id)
        assert [f[0] for f in await b.frames(4)] == [1, 0, 3, 2]
        a.send(0x9)  # held back with no later frame, and released by clearing
        while "reorder" in str(hub.state()["faults"]):
            await asyncio.sleep(0.01)
            hub.clear("reorder")
        assert await b.receive() == (0x9, "")


@on_loop
async def test_bus_off_is_reported_then_silent_until_cleared(tmp_path: Path) -> None:
    async with bus(tmp_path, 2) as (hub, (a, b)):
        hub.inject("bus_off")
        errors = [f[0] for f in await b.frames(5)]
        assert errors == [PROTOCOL_ERROR] * 4 + [BUS_OFF]
        a.send(0x80)
        assert await b.silent()
        hub.clear("bus_off")
        assert (await b.receive())[0] == RESTARTED
        a.send(0x80)
        assert await b.receive() == (0x80, "")


@on_loop
async def test_a_wrong_bitrate_gives_error_frames_only(tmp_path: Path) -> None:
    async with bus(tmp_path, 2) as (hub, (a, b)):
        hub.inject("wrong_bitrate")
        a.send(0x80)
        assert (await b.receive())[0] == PROTOCOL_ERROR
        assert (await a.receive())[0] == PROTOCOL_ERROR  # the sender's own controller too
        node = hub.attach(lambda can_id, data, t_ns: None)
        node.send(0x701, b"\0")
        assert (await b.receive())[0] == PROTOCOL_ERROR


@on_loop
async def test_stalled_bus_accepts_frames_until_queue_is_full(tmp_path: Path) -> None:
    async with bus(tmp_path, 2) as (hub, (a, b)):
        hub.inject("stalled")
        sent = 0
        with pytest.raises(BlockingIOError):
            while True:
                a.send(0x80)
                sent += 1
        assert await b.silent()
        hub.clear("stalled")
        assert len(await b.frames(sent)) == sent


@on_loop
async def test_babbling_node_sends_continuously(tmp_path: Path) -> None:
    async with bus(tmp_path, 1) as (hub, (a,)):
        start = time.monotonic()
        hub.inject("babble", id=0x001, rate_hz=2000.0, length=2)
        assert set(await a.frames(200)) == {(0x001, "00 00")}
        assert time.monotonic() - start >= 199 / 2000
        hub.clear("babble")
        while not await a.silent():
            pass


@pytest.mark.parametrize(
    ("fault", "options", "words"),
    [
        ("flood", {}, "bus has no fault 'flood'.*babble"),
        ("drop", {"probability": 1.5}, "'probability' is 1.5, expected 0 to 1"),
        ("delay", {}, "'delay_s' is missing"),
        ("drop", {"id": "x"}, "'id' is 'x', expected int"),
        ("drop", {"cob": 1}, "takes no option cob"),
    ],
)
def test_faults_that_cannot_be_shown_are_refused(
    tmp_path: Path, fault: str, options: dict[str, object], words: str
) -> None:
    hub = CanHub("bus", tmp_path / "bus")
    with pytest.raises(ValueError, match=words):
        hub.inject(fault, **options)
    assert hub.state()["faults"] == ""
