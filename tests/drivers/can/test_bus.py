"""The bus: other nodes, floods, errors, and its end."""

from __future__ import annotations

import socket
import time
from pathlib import Path

import can
import pytest
from support.can.bench import Clock, Connect
from support.can.script import ScriptedBus, use
from support.descriptors import beyond_select

from rigd.sdk import LinkError
from rigd_drivers.can.bus import FRAMES_PER_MS, CanBus, CanBusConfig
from rigd_drivers.can.cia402_servo.current import CurrentServo, CurrentServoConfig
from rigd_drivers.can.load import FRAME_BITS, WINDOW_NS, LoadMeter
from rigd_drivers.can.ports import Full, open_port

#: A frame of 8 bytes with stuff bits, at 1 Mbit/s.
FRAME_S = 135e-6


@pytest.mark.parametrize(
    ("identifier", "data", "does"),
    [
        (0x080, "", "sends SYNC"),
        (0x77F, "05", "sends the heartbeat of node 127"),
        (0x000, "01 00", "sends NMT commands"),
    ],
)
@pytest.mark.parametrize("late", [False, True])
def test_second_master_on_bus_ends_the_run(
    monkeypatch: pytest.MonkeyPatch, identifier: int, data: str, does: str, late: bool
) -> None:
    port = use(ScriptedBus(), monkeypatch)
    bus = CanBus(CanBusConfig(interface="scripted"))
    if late:
        bus.open()
    port.say(identifier, data)
    with pytest.raises(LinkError, match=f"another rigd .*drives .*: it {does}"):
        bus.begin(0) if late else bus.open()
    assert port.sent == []
    assert bus.is_open is late


def test_another_node_sends_sync_if_rig_file_permits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    port = use(ScriptedBus(), monkeypatch)
    bus = CanBus(CanBusConfig(interface="scripted", sync=False))
    bus.open()
    port.say(0x080, "")
    bus.begin(0)
    bus.end(0)
    assert bus.syncs == 1
    assert 0x080 not in [identifier for identifier, _ in port.sent]


def test_frames_of_other_nodes_are_ignored(connect: Connect) -> None:
    bus, port = connect(listen=True)
    for identifier in (0x70B, 0x18B, 0x8000_0181, 0x4000_0181):
        port.say(identifier, "05")
    bus.begin(0)
    assert bus.foreign == 4
    assert bus.heard == {11}


def test_heartbeat_comes_from_cycle_and_only_when_due(connect: Connect, clock: Clock) -> None:
    bus, port = connect()
    for _ in range(100):  # 100 ms
        bus.begin(0)
        bus.end(0)
        clock.pass_by(1e-3)
    beats = [data for identifier, data in port.sent if identifier == 0x77F]
    assert set(beats) == {b"\x05"}
    assert 4 <= len(beats) <= 8  # one in 20 ms, and as many more as this host stalled
    assert port.sent[0] == (0x080, b"")
    before = len(port.sent)
    clock.pass_by(10.0)
    assert len(port.sent) == before


def test_flood_is_read_in_pieces_and_names_node(connect: Connect, clock: Clock) -> None:
    bus, port = connect()
    heard: list[bytes] = []
    bus.subscribe(0x181, heard.append)
    for _ in range(2):
        bus.begin(0)
        bus.end(0)

    def flood() -> None:
        for _ in range(FRAMES_PER_MS):
            port.say(0x3A5, bytes(8))
        port.say(0x181, "01")

    flood()
    bus.begin(0)
    assert bus.behind
    assert heard == []
    bus.end(0)
    bus.begin(0)  # one frame was left
    assert not bus.behind
    assert heard == [b"\x01"]
    with pytest.raises(LinkError, match=r"flooded: .*0x3A5 \(TPDO3 of node 37\)"):
        for _ in range(100):
            flood()
            clock.pass_by(1e-3)
            bus.begin(0)


def test_single_endless_identifier_is_a_flood_too(connect: Connect, clock: Clock) -> None:
    bus, port = connect()

    def come(times: int) -> None:
        for _ in range(60):
            for _ in range(times):
                port.say(0x3A5, bytes(8))
            clock.pass_by(1e-3)
            bus.begin(0)
            bus.end(0)

    come(2)  # another rig's node, at twice our rate
    with pytest.raises(LinkError, match=r"is flooded: .*frames 0x3A5"):
        come(20)


@pytest.mark.parametrize(("period_ms", "stall_ms"), [(1, 1000), (50, 0)])
def test_full_bus_after_stall_is_no_flood(
    connect: Connect, clock: Clock, period_ms: int, stall_ms: int
) -> None:
    bus, port = connect()
    bus.begin(0)
    bus.end(0)

    def come(for_ms: int) -> None:
        clock.pass_by(for_ms * 1e-3)
        for number in range(20 * for_ms):  # the shortest frames, at 1 Mbit/s
            port.say(0x301 + number % 64, "")
        bus.begin(0)
        bus.end(0)

    come(stall_ms)
    for _ in range(0, 2000, period_ms):
        come(period_ms)
    assert not bus.behind


def test_bus_off_ends_it_at_once(connect: Connect) -> None:
    bus, port = connect()
    port.say(0x2000_0040, bytes(8))
    with pytest.raises(LinkError, match="bus-off") as caught:
        bus.begin(0)
    assert "bitrate" in (caught.value.hint or "")


@pytest.mark.parametrize("good", [0x70B, 0x98FE_F121])
def test_bus_errors_end_run_only_without_good_frames(connect: Connect, good: int) -> None:
    bus, port = connect()
    for _ in range(40):
        port.say(0x2000_0008, bytes(8))
        port.say(good, "05")
        bus.begin(0)
    with pytest.raises(LinkError, match="frames are destroyed"):
        for _ in range(16):
            port.say(0x2000_0008, bytes(8))
            bus.begin(0)


def test_error_frames_alone_at_opening_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    port = use(ScriptedBus(), monkeypatch)
    port.say(0x2000_0088, bytes(8))
    with pytest.raises(LinkError, match="only errors are heard"):
        CanBus(CanBusConfig(interface="scripted")).open()
    assert port.closed == 1


@pytest.mark.parametrize("heard", [(0x2000_0088, 0x98FE_F121), (0x70B, 0x2000_0088)])
def test_good_frame_beside_an_error_permits_opening(
    connect: Connect, heard: tuple[int, int]
) -> None:
    bus, port = connect()
    for identifier in heard:
        port.say(identifier, bytes(8))
    bus.open()
    assert bus.errors == 1


class ShortQueue(ScriptedBus):
    """A bus of 1 Mbit/s behind a queue of 10 frames, the default of SocketCAN."""

    def __init__(self) -> None:
        super().__init__()
        self._empty_s = 0.0

    def send(self, identifier: int, data: bytes) -> None:
        now_s = time.monotonic()
        self._empty_s = max(self._empty_s, now_s)
        if self._empty_s - now_s > 10 * FRAME_S:
            raise Full("its queue is full")
        self._empty_s += FRAME_S
        super().send(identifier, data)


def test_all_drives_are_disabled_through_a_short_queue(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    port = use(ShortQueue(), monkeypatch)
    bus = CanBus(CanBusConfig(interface="scripted"))
    bus.open_second()
    options = {"counts_per_revolution": "4096 count/rev", "current_range": "5 A"}
    nodes = range(1, 7)
    drives = [
        CurrentServo(CurrentServoConfig.model_validate({"node": node, **options}), bus)
        for node in nodes
    ]
    for drive in drives:
        drive.make_safe()
    told = {identifier for identifier, data in port.sent if data == bytes(4)}
    assert told == {0x200 + node for node in nodes}


def test_queue_may_be_full_only_for_a_moment(connect: Connect, clock: Clock) -> None:
    bus, port = connect()
    port.full = True
    bus.begin(0)
    bus.end(0)
    assert port.sent == []
    port.full = False
    clock.pass_by(0.2)
    bus.begin(0)
    bus.end(0)
    port.full = True
    bus.end(0)
    clock.pass_by(0.1)
    with pytest.raises(LinkError, match="takes no frames") as caught:
        bus.end(0)
    assert "no node acknowledges" in (caught.value.hint or "")


def test_closed_bus_raises_an_error() -> None:
    bus = CanBus(CanBusConfig(interface="hub", channel="nowhere"))
    bus.close()
    with pytest.raises(LinkError, match="is not open"):
        bus.begin(0)


def test_missing_simulated_bus_error_names_command(tmp_path: Path) -> None:
    bus = CanBus(CanBusConfig(interface="hub", channel=str(tmp_path / "bus")))
    with pytest.raises(LinkError, match="no simulated CAN bus") as caught:
        bus.open()
    assert "rigd sim" in (caught.value.hint or "")


def test_simulated_bus_that_ends_is_lost(tmp_path: Path) -> None:
    path = str(tmp_path / "bus")
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(path)
        listener.listen()
        bus = CanBus(CanBusConfig(interface="hub", channel=path))
        bus.open_second()
        peer, _ = listener.accept()
        peer.send(bytes.fromhex("0b 07 00 00 01 00 00 00 05 00 00 00 00 00 00 00"))
        bus.begin(0)
        assert bus.heard == {11}
        bus.end(0)
        assert peer.recv(32) == bytes.fromhex("80 00 00 00 00 00 00 00" + "00" * 8)
        peer.close()
    try:
        with pytest.raises(LinkError, match="is gone: "):
            bus.begin(0)
        with pytest.raises(LinkError, match="is gone: "):
            bus.end(0)
    finally:
        bus.close()


def test_frame_is_awaited_beyond_1024_descriptors(tmp_path: Path) -> None:
    path = str(tmp_path / "bus")
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(path)
        listener.listen()
        with beyond_select():
            port = open_port("hub", path, 1_000_000)
            peer, _ = listener.accept()
            with peer:
                peer.send(bytes.fromhex("80 00 00 00 00 00 00 00") + bytes(8))
                port.wait(5.0)
                assert port.receive() == (0x080, b"")
            port.close()


def test_last_frame_sent_arrives_although_frames_are_unread(tmp_path: Path) -> None:
    path = str(tmp_path / "bus")
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(path)
        listener.listen()
        port = open_port("hub", path, 1_000_000)
        peer, _ = listener.accept()
        with peer:
            for _ in range(10):
                peer.send(bytes(16))
            port.send(0x000, b"\x80\x01")
            port.close()
            assert peer.recv(32) == bytes.fromhex("00 00 00 00 02 00 00 00 80 01") + bytes(6)
            assert peer.recv(32) == b""


def test_missing_socketcan_interface_error_has_a_hint() -> None:
    with pytest.raises(LinkError, match=r"no CAN interface 'nosuchcan'|has no SocketCAN"):
        open_port("socketcan", "nosuchcan", 500_000)


def test_unknown_adapter_is_named_with_those_there_are() -> None:
    with pytest.raises(LinkError, match="nosuch 1 cannot be opened") as caught:
        open_port("nosuch", "1", 500_000)
    assert "pcan" in (caught.value.hint or "")


def test_adapter_of_python_can_carries_frames_both_ways() -> None:
    port = open_port("virtual", "rigd-test", 500_000, {"receive_own_messages": "False"})
    with can.Bus(interface="virtual", channel="rigd-test") as peer:
        port.send(0x201, b"\x0f\x00")
        seen = peer.recv(1.0)
        assert seen is not None
        assert (seen.arbitration_id, bytes(seen.data), seen.is_extended_id) == (
            0x201, b"\x0f\x00", False
        )  # fmt: skip
        assert port.receive() is None
        peer.send(can.Message(arbitration_id=0x181, data=b"\x37\x12", is_extended_id=False))
        port.wait(1.0)
        assert port.receive() == (0x181, b"\x37\x12")
        peer.send(can.Message(arbitration_id=0x181, is_extended_id=True))
        peer.send(can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False))
        assert port.receive() == (0x8000_0181, b"")
        assert port.receive() == (0x2000_0008, b"")
    port.close()


@pytest.mark.parametrize(("identifier", "most"), [(0x18B, 135), (0x98FE_F121, 160)])
def test_load_is_the_largest_share_of_frame_time(
    connect: Connect, clock: Clock, identifier: int, most: int
) -> None:
    bus, port = connect(listen=True)
    clock.pass_by(1.0)
    began_ns = clock()
    bus.end(0)  # a window begins
    before = len(port.sent)
    for _ in range(100):
        port.say(identifier, "00 11 22 33 44 55 66 77")
        bus.begin(0)
        bus.end(0)
        clock.pass_by(0.0001)
    clock.pass_by(0.6)
    bus.end(0)
    # 11 bits: 135 bits with 8 bytes, 55 without any (SYNC), 65 with one (heartbeat); at 1 Mbit/s.
    bits = 100 * most + sum({0: 55, 1: 65}[len(data)] for _, data in port.sent[before:])
    took_s = (clock() - began_ns) * 1e-9
    assert bus.load is not None
    assert bits / 1e6 / took_s <= bus.load <= bits / 1e6 / 0.6


def test_a_load_is_that_of_its_window_alone() -> None:
    meter = LoadMeter(bitrate=500e3, now_ns=0)
    meter.bits += 10 * FRAME_BITS[8]
    meter.look(WINDOW_NS - 1)
    assert meter.load is None
    meter.look(WINDOW_NS)
    assert meter.load == pytest.approx(1350 / 250e3)
    meter.look(2 * WINDOW_NS)
    assert meter.load == 0.0


def test_bit_rate_other_than_of_cia_is_refused() -> None:
    options = {"interface": "hub", "bitrate": "123 kbit/s"}
    with pytest.raises(ValueError, match="123 kbit/s is no bit rate of CANopen: 10, 20, 50, 125"):
        CanBusConfig.model_validate(options)
    assert CanBusConfig.model_validate(options | {"bitrate": "125 kbit/s"}).bitrate == 125e3
