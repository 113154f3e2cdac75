"""A bus that nobody waits on is read all the same, and what was lost of it is named."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from support.can.bench import Clock, Connect, encoder, wheel
from support.can.foreign import FOREIGN, packet
from support.can.script import ScriptedBus, servo
from support.can.script import encoder as scripted_encoder

from rigd.sdk import DeviceError, LinkError
from rigd.sdk.check import background_loop
from rigd_drivers.can.bus import CanBus, CanBusConfig
from rigd_drivers.can.canopen import objects
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.node import Node
from rigd_sim.wire.can.hub import CanHub

#: More than any queue of a socket holds, and how long a crowded machine may take for them.
MANY, PATIENCE_S = 5000, 60.0
#: Frames for which a port of these tests has room.
ROOM = 40
ENTRY = Entry(0x6500, 0, "I", "a value of the test")


@contextmanager
def peer_of(tmp_path: Path) -> Iterator[tuple[CanBus, socket.socket]]:
    """A bus that is open, and the other end of its socket."""
    path = str(tmp_path / "bus")
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(path)
        listener.listen()
        bus = CanBus(CanBusConfig(interface="hub", channel=path))
        bus.open_second()
        peer, _ = listener.accept()
        with peer:
            peer.setblocking(False)
            try:
                yield bus, peer
            finally:
                bus.close()


def sent(peer: socket.socket, count: int, timeout_s: float) -> int:
    """Return how many of ``count`` foreign frames were taken; each within ``timeout_s``."""
    poll = select.poll()
    poll.register(peer, select.POLLOUT)
    for number in range(count):
        try:
            peer.send(packet(*FOREIGN[number % len(FOREIGN)]))
        except BlockingIOError:
            if not poll.poll(timeout_s * 1e3):
                return number
    return count


def test_open_bus_is_read_though_nobody_waits(tmp_path: Path) -> None:
    with peer_of(tmp_path) as (_, peer):
        assert sent(peer, MANY, PATIENCE_S) == MANY


def test_cycle_alone_reads_until_it_ends(tmp_path: Path) -> None:
    with peer_of(tmp_path) as (bus, peer):
        bus.begin(0)
        bus.end(0)
        assert sent(peer, MANY, timeout_s=0.2) < MANY
        bus.idle()
        assert sent(peer, MANY, PATIENCE_S) == MANY


def test_end_of_an_idle_bus_is_raised(tmp_path: Path) -> None:
    with peer_of(tmp_path) as (bus, peer):
        peer.close()
        deadline = time.monotonic() + PATIENCE_S
        with pytest.raises(LinkError, match="is gone: "):
            while time.monotonic() < deadline:
                bus.wait(lambda: False, 0.01)


def test_rig_opens_after_its_bus_was_unread(connect: Connect) -> None:
    bus, port = connect(servo(), scripted_encoder(), room=ROOM)
    for _ in range(500):  # 200 frames/s for 2.5 s
        port.say(0x3A5, "01")
    for device in (wheel(bus), encoder(bus)):
        device.open()
    assert bus.lost > 500 - ROOM


def full(connect: Connect, **options: object) -> tuple[Node, ScriptedBus]:
    """A node on a bus whose queue is full, so that its answer is lost."""
    drive = servo()
    drive.objects |= {(0x6500, 0): bytes(4)}
    for name, value in options.items():
        setattr(drive, name, value)
    bus, port = connect(drive, room=ROOM)
    for _ in range(ROOM):
        port.say(0x3A5, "01")
    node = Node(bus, 1)
    node.attach()
    node.sdo_timeout_s = 0.05
    return node, port


def test_lost_answer_to_a_write_is_read_back(connect: Connect) -> None:
    node, port = full(connect)
    node.write(ENTRY, 4711)
    assert node.bus.lost == 1
    assert node.read(ENTRY) == 4711
    writes = [data for to, data in port.sent if to == 0x601 and data[0] == 0x23]
    assert len(writes) == 1


def test_overflow_is_named_and_not_the_wiring(connect: Connect, clock: Clock) -> None:
    node, port = full(connect, silent=True)
    for _ in range(812):
        port.say(0x3A5, "01")
    with pytest.raises(LinkError, match=r"does not answer within 0.05 s \(SDO 1000:00\)") as plain:
        node.read(objects.DEVICE_TYPE)
    assert "wiring" in (plain.value.hint or "")  # none was lost since it was asked
    node.bus.now_ns = clock() + 10**9
    with pytest.raises(DeviceError, match=r"no heartbeat .*the bus overflowed: 812 frames lost"):
        node.watch(forgive_silence=False)


def test_simulated_bus_tells_what_it_lost(tmp_path: Path, clock: Clock) -> None:
    hub = CanHub("bus", tmp_path / "bus")
    bus = CanBus(CanBusConfig(interface="hub", channel=str(tmp_path / "bus")))

    async def crowd(count: int) -> int:
        for _ in range(count):
            hub.submit(None, 0x3A5, b"\x01")
        return int(hub.state()["lost"])

    with background_loop() as run:
        run(hub.start())
        bus.open_second()
        clock.stand()
        bus.begin(0)  # from now on only a cycle reads
        lost = run(crowd(MANY))
        clock.pass_by(0.01)  # all that the socket holds is taken: no flood
        bus.begin(0)
        assert run(crowd(1)) == lost  # in front of it comes the report
        bus.begin(0)
        assert bus.lost == lost > 0
        assert bus.errors == 0
        bus.close()
        run(hub.stop())
