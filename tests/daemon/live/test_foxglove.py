"""The Foxglove server, asked by an independent client: RFC 6455 and ``foxglove.sdk.v1`` by hand.

Messages: https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md (the SDK's protocol has
the same ones): JSON texts ``serverInfo``, ``advertise``, ``subscribe``; a binary message is opcode
1, u32 subscription, u64 time in ns, payload.
"""

from __future__ import annotations

import base64
import json
import os
import socket
import struct
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from support.daemon.live import START_NS
from support.daemon.ring_writer import numbered
from support.faults.stalls import witnessed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from rigd.config.loader import load_rig
from rigd.daemon.live.foxglove import STOP_S, FoxgloveServer
from rigd.engine.cycle.wiring import streams_of
from rigd.model.channels import Channel, Stream
from rigd.model.errors import ConfigError, LinkError
from rigd.model.machine.extras import MissingExtra
from rigd.record.events.event import Event
from rigd.record.mcap.schema import stream_from_json

RIG = load_rig("angle-1")
STREAMS = {stream.name: stream for stream in streams_of(RIG)}
PROTOCOL = Subprotocol("foxglove.sdk.v1")
PATIENCE_S = 60.0  #: in which anything comes, on a crowded machine


@pytest.fixture
def server() -> Iterator[FoxgloveServer]:
    served = FoxgloveServer(RIG, 0)
    yield served
    served.stop()


@pytest.fixture
def client(server: FoxgloveServer) -> Iterator[ClientConnection]:
    with connect(server.address, subprotocols=[PROTOCOL]) as connection:
        yield connection


def told(client: ClientConnection, op: str) -> dict[str, Any]:
    """The next text of a kind."""
    while True:
        message = client.recv(PATIENCE_S)
        if isinstance(message, str) and (said := json.loads(message))["op"] == op:
            return dict(said)


def topics(client: ClientConnection) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    while len(found) <= len(STREAMS):  # and /trial
        found |= {item["topic"]: item for item in told(client, "advertise")["channels"]}
    return found


def subscribe(client: ClientConnection, server: FoxgloveServer, *names: str) -> None:
    """Subscribe to streams; the number of each subscription is its place in ``names``."""
    known = topics(client)
    wanted = [{"id": n, "channelId": known[f"/{name}"]["id"]} for n, name in enumerate(names)]
    client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    until = time.monotonic() + PATIENCE_S
    while not all(server._topics[name].channel.has_sinks() for name in names):
        assert time.monotonic() < until
        time.sleep(0.005)


def received(client: ClientConnection) -> tuple[int, int, bytes]:
    """The next sample: subscription, time, payload."""
    while True:
        message = client.recv(PATIENCE_S)
        if isinstance(message, bytes) and message[0] == 1:
            number, t_ns = struct.unpack_from("<IQ", message, 1)
            return number, t_ns, message[13:]


def test_server_offers_streams_of_rig_read_only(
    client: ClientConnection,
) -> None:
    assert told(client, "serverInfo")["capabilities"] == []
    found = topics(client)
    assert set(found) == {"/trial", *(f"/{name}" for name in STREAMS)}
    for name, stream in STREAMS.items():
        topic = found[f"/{name}"]
        assert (topic["encoding"], topic["schemaEncoding"]) == ("cdr", "ros2msg")
        lines = [
            splitline for splitline in topic["schema"].splitlines() if not splitline.startswith("#")
        ]
        fields = [f"float64 {channel.name}" for channel in stream.channels]
        assert lines == fields + ["uint32 status"] * stream.has_status
        assert stream_from_json(topic["metadata"]["rigd.stream"]) == stream


def test_a_row_arrives_bit_for_bit(server: FoxgloveServer, client: ClientConnection) -> None:
    subscribe(client, server, "relay", "daq")
    for number, name in enumerate(("relay", "daq")):
        rows = numbered(STREAMS[name], START_NS, 7, 3)
        rows[STREAMS[name].channels[0].name][0] = np.nan
        server.show(STREAMS[name], rows[:1])
        subscription, t_ns, payload = received(client)
        assert (subscription, t_ns) == (number, rows["t_ns"][0])
        assert payload[:4] == b"\x00\x01\x00\x00"  # CDR, little-endian (OMG DDSI-RTPS 10.2.1.2)
        count = len(STREAMS[name].channels)
        values = struct.unpack(f"<{count}d", payload[4 : 4 + 8 * count])
        assert np.isnan(values[0])
        assert values[1:] == tuple(7 + index / 64 for index in range(1, count))
        status = payload[4 + 8 * count :]
        assert status == (struct.pack("<I", 7) if STREAMS[name].has_status else b"")


def test_trial_and_step_of_a_run_arrive(server: FoxgloveServer, client: ClientConnection) -> None:
    number = topics(client)["/trial"]["id"]
    client.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 0, "channelId": number}]}))
    until = time.monotonic() + PATIENCE_S
    while server._trial is None or not server._trial.has_sinks():
        assert time.monotonic() < until
        time.sleep(0.005)
    server.happened(Event(START_NS, "trial_start", 3, {"repeat": 1}))
    server.happened(Event(START_NS + 5, "step", 3, {"name": "rest"}))
    assert received(client)[1] == START_NS
    _, t_ns, payload = received(client)
    assert t_ns == START_NS + 5
    assert struct.unpack_from("<4x3iI5s", payload) == (3, 1, 0, 5, b"rest\0")


def test_a_fast_stream_is_thinned_evenly(server: FoxgloveServer, client: ClientConnection) -> None:
    subscribe(client, server, "daq", "cycle")
    first = 0
    for count in (1, 3, 319, 5, 20, 52):
        server.show(STREAMS["daq"], numbered(STREAMS["daq"], START_NS, first, count))
        first += count
    server.show(STREAMS["cycle"], numbered(STREAMS["cycle"], START_NS, 0, 1))
    numbers: list[float] = []
    while (sample := received(client))[0] == 0:
        numbers.append(*struct.unpack_from("<d", sample[2], 4))
    assert numbers == list(range(0, 400, 10))  # of 9600 Hz


def test_foxglove_commands_are_refused(server: FoxgloveServer, client: ClientConnection) -> None:
    subscribe(client, server, "cycle")
    for request in (
        {"op": "advertise", "channels": [{"id": 1, "topic": "/x", "encoding": "json",
                                          "schemaName": ""}]},
        {"op": "setParameters", "parameters": [{"name": "floor", "value": 1}]},
        {"op": "fetchAsset", "requestId": 1, "uri": "file:///etc/passwd"},
    ):  # fmt: skip
        client.send(json.dumps(request))
        assert told(client, "status")["level"] == 2
    client.send(b"\x01" + struct.pack("<I", 1) + b"{}")  # a message of the client's
    assert told(client, "status")["level"] == 2
    client.send(b"\x02" + struct.pack("<III", 1, 1, 4) + b"json{}")  # a service call
    assert "does not support services" in told(client, "serviceCallFailure")["message"]
    client.send("[" * 1000)
    assert told(client, "status")["level"] == 2
    server.show(STREAMS["cycle"], numbered(STREAMS["cycle"], START_NS, 0, 1))
    assert received(client)[1] == START_NS


def test_client_that_reads_nothing_delays_no_other() -> None:
    server = FoxgloveServer(RIG, 0)
    port = int(server.address.rpartition(":")[2])
    with (
        socket.create_connection(("127.0.0.1", port)) as frozen,
        connect(server.address, subprotocols=[PROTOCOL]) as client,
    ):
        frozen.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        key = base64.b64encode(os.urandom(16)).decode()
        frozen.sendall(
            f"GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
            f"Sec-WebSocket-Protocol: {PROTOCOL}\r\n\r\n".encode()
        )
        assert frozen.recv(12).startswith(b"HTTP/1.1 101")
        channel = topics(client)["/daq"]["id"]
        wanted = json.dumps(
            {"op": "subscribe", "subscriptions": [{"id": 1, "channelId": channel}]}
        ).encode()
        mask = os.urandom(4)
        masked = bytes(byte ^ mask[place % 4] for place, byte in enumerate(wanted))
        frozen.sendall(bytes([0x81, 0x80 | len(wanted)]) + mask + masked)
        until = time.monotonic() + PATIENCE_S
        while not server._topics["daq"].channel.has_sinks():
            assert time.monotonic() < until
            time.sleep(0.005)
        with witnessed() as lost_s:
            began = time.monotonic()
            for first in range(0, 960_000, 9600):
                server.show(STREAMS["daq"], numbered(STREAMS["daq"], START_NS, first, 9600))
            assert time.monotonic() - began < 10.0 + lost_s()  # 100 s of samples
        until = time.monotonic() + PATIENCE_S
        client.send(
            json.dumps({"op": "subscribe", "subscriptions": [{"id": 9, "channelId": channel}]})
        )
        while True:
            server.show(STREAMS["daq"], numbered(STREAMS["daq"], START_NS, 5, 10))
            try:
                if isinstance(client.recv(0.1), bytes):
                    break
            except TimeoutError:
                assert time.monotonic() < until
        with witnessed() as lost_s:
            began = time.monotonic()
            server.stop()
            assert time.monotonic() - began < STOP_S + 5 + lost_s()


@pytest.mark.parametrize("port", [-1, 65536])
def test_invalid_port_is_refused(port: int) -> None:
    with pytest.raises(ConfigError, match="from 0 to 65535"):
        FoxgloveServer(RIG, port)


def test_occupied_port_and_missing_sdk_are_reported(
    server: FoxgloveServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = int(server.address.rpartition(":")[2])
    with pytest.raises(LinkError, match=f"127.0.0.1:{port}.*in use"):
        FoxgloveServer(RIG, port)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(MissingExtra, match=r"rigd\[foxglove\]"):
        FoxgloveServer(RIG, 0)


def test_stream_of_a_run_becomes_a_topic(server: FoxgloveServer, client: ClientConnection) -> None:
    topics(client)
    for names in (("force",), ("force", "power")):
        stream = Stream("own", tuple(Channel(name, "N") for name in names))
        server.show(stream, numbered(stream, START_NS, 0, 1))
        (offered,) = told(client, "advertise")["channels"]
        assert offered["topic"] == "/own"
        assert stream_from_json(offered["metadata"]["rigd.stream"]) == stream
