"""With any message the server lives, reports the reason, counts it, and answers others."""

from __future__ import annotations

import json
import logging
import random
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack

import pytest
from support.daemon.served_rig import ARGUMENTS, RIG, Served, key, request
from support.daemon.zenoh_client import ZenohClient
from support.faults.spoilt import spoilt_payloads
from support.faults.stalls import witnessed

from rigd.model import LinkError
from rigd.remote.protocol import Code, Lane, Refusal
from rigd.remote.protocol.limits import MAX_REQUEST_BYTES


class HangingLog(logging.Handler):
    """Writes nothing until it is let go."""

    def __init__(self) -> None:
        super().__init__()
        self.begun, self.let_go = threading.Event(), threading.Event()

    def emit(self, record: logging.LogRecord) -> None:
        """Hang."""
        self.begun.set()
        self.let_go.wait(60)


@pytest.fixture
def client(on_loopback: Served) -> Iterator[ZenohClient]:
    with on_loopback.client() as opened:
        yield opened


def code(client: ZenohClient, kind: str, verb: str, payload: bytes) -> str:
    """The code of the refusal that a request gets."""
    return str(client.ask(key(kind, "eve", verb), payload)["error"]["code"])


@pytest.mark.parametrize(
    ("verb", "payload", "expected", "counted"),
    [
        ("lease_take", b"", "bad_request", "malformed"),
        ("lease_take", b"[" * 60_000, "bad_request", "malformed"),
        ("lease_take", b'{"a":' * 12_000, "bad_request", "malformed"),
        ("lease_take", request("lease_take", v=2), "version", "malformed"),
        ("lease_take", request("lease_take", args={"x": 1}), "bad_request", "malformed"),
        ("lease_steal", request("lease_take"), "unknown_verb", "malformed"),
        ("lease_take", b" " * (MAX_REQUEST_BYTES + 1), "too_large", "oversized"),
        ("lease_take", request("lease_take", sent_ns=0), "replayed", "replayed"),
        ("act", request("act"), "forbidden", "forbidden"),
    ],
    ids=lambda value: f"{len(value)} bytes" if isinstance(value, bytes) else None,
)
def test_refusal_is_reported_and_counted(
    on_loopback: Served,
    client: ZenohClient,
    verb: str,
    payload: bytes,
    expected: str,
    counted: str,
) -> None:
    done, before = list(on_loopback.rig.done), on_loopback.server.refused().model_dump()
    assert code(client, "cmd", verb, payload) == expected
    after = on_loopback.server.refused().model_dump()
    assert after == before | {counted: before[counted] + 1}
    assert on_loopback.rig.done == done


@pytest.mark.parametrize("verb", ["stop", "abort", "estop"])
@pytest.mark.parametrize(
    ("payload", "expected"),
    [
        (json.dumps({"v": 7, "whatever": "a version to come may say"}).encode(), "version"),
        (b"", "bad_request"),
        (b"{}", "bad_request"),
        (b"not json", "bad_request"),
        (request("stop", args={"reason": 7}), "bad_request"),
    ],
)
def test_a_stop_is_carried_out_with_any_content(
    on_loopback: Served, client: ZenohClient, verb: str, payload: bytes, expected: str
) -> None:
    before = len(on_loopback.rig.done)
    error = client.ask(key("stop", "eve", verb), payload)["error"]
    assert on_loopback.rig.done[before:] == [("eve", verb)]
    assert error["code"] == expected
    assert error["message"].startswith(f"{verb}: carried out; ")


def test_stop_with_long_odd_reason_is_carried_out(on_loopback: Served, client: ZenohClient) -> None:
    before = len(on_loopback.rig.done)
    payload = request("stop", args={"reason": 1666 * "a\n\x1b"})
    assert "result" in client.ask(key("stop", "eve", "stop"), payload)
    assert on_loopback.rig.done[before:] == [("eve", "stop")]


def test_far_too_large_message_never_arrives(on_loopback: Served, client: ZenohClient) -> None:
    before = on_loopback.server.refused()
    for size in (5 * MAX_REQUEST_BYTES, 15 * MAX_REQUEST_BYTES):
        assert client.get(key("cmd", "eve", "lease_take"), b" " * size) == []
    assert on_loopback.server.refused() == before
    assert "result" in client.ask(key("ask", "eve", "latest"), request("latest"))


def test_repeated_request_acts_once_with_same_reply(
    on_loopback: Served, client: ZenohClient
) -> None:
    on_loopback.rig.hold_lease("eve")
    before = len(on_loopback.rig.done)
    payload = request("pause")
    replies = [client.ask(key("cmd", "eve", "pause"), payload) for _ in range(3)]
    assert on_loopback.rig.done[before:] == [("eve", "pause")]
    assert replies == [replies[0]] * 3
    assert replies[0]["result"] == {}


def test_id_of_request_cannot_serve_another(on_loopback: Served, client: ZenohClient) -> None:
    on_loopback.rig.hold_lease("eve")
    payload = request("pause")
    client.ask(key("cmd", "eve", "pause"), payload)
    before = list(on_loopback.rig.done)
    assert code(client, "cmd", "resume", payload) == "replayed"
    later = json.dumps(json.loads(payload) | {"sent_ns": time.time_ns()}).encode()
    assert code(client, "cmd", "pause", later) == "replayed"
    assert on_loopback.rig.done == before


def test_stop_is_accepted_with_any_clock(on_loopback: Served, client: ZenohClient) -> None:
    before = len(on_loopback.rig.done)
    reply = client.ask(key("stop", "eve", "abort"), request("abort", sent_ns=0))
    assert "result" in reply
    assert on_loopback.rig.done[before:] == [("eve", "abort")]


def test_lease_is_renewed_with_any_clock(on_loopback: Served, client: ZenohClient) -> None:
    """Else a clock change would end the run of a client that is connected."""
    on_loopback.rig.hold_lease("eve")
    payload = request("lease_renew", sent_ns=0)
    first, second = (client.ask(key("cmd", "eve", "lease_renew"), payload) for _ in range(2))
    assert second["result"]["until_ns"] > first["result"]["until_ns"]


@pytest.mark.parametrize(
    ("error", "expected", "told"),
    [
        (RuntimeError("secret"), "internal", "pause failed in the daemon"),
        (LinkError("no answer from scale", hint="plug it in"), "refused", "no answer from scale"),
        (Refusal(Code.CONFLICT, "nothing runs"), "conflict", "nothing runs"),
    ],
)
def test_failure_is_reported_and_not_repeated(
    on_loopback: Served, client: ZenohClient, error: Exception, expected: str, told: str
) -> None:
    on_loopback.rig.hold_lease("eve")
    on_loopback.rig.fails, on_loopback.rig.error = "pause", error
    before = len(on_loopback.rig.done)
    payload = request("pause")
    replies = [client.ask(key("cmd", "eve", "pause"), payload) for _ in range(2)]
    on_loopback.rig.fails = ""
    assert replies == [replies[0]] * 2
    assert replies[0]["error"]["code"] == expected
    assert replies[0]["error"]["message"] == told
    assert on_loopback.rig.done[before:] == [("eve", "pause")]
    assert client.ask(key("cmd", "eve", "pause"), request("pause"))["result"] == {}


def test_too_large_reply_is_reported(on_loopback: Served, client: ZenohClient) -> None:
    few, on_loopback.rig.runs = on_loopback.rig.runs, on_loopback.rig.runs * 1000
    try:
        assert code(client, "ask", "runs", request("runs")) == "too_large"
    finally:
        on_loopback.rig.runs = few
    assert "result" in client.ask(key("ask", "eve", "runs"), request("runs"))


@pytest.mark.parametrize(
    "name", ["eve ", "é", "e" * 65, "e" * 30_000, ".."], ids=lambda name: name[:8]
)
def test_odd_names_are_refused_or_are_names(
    on_loopback: Served, client: ZenohClient, name: str
) -> None:
    before = list(on_loopback.rig.done)
    replies = client.get(key("cmd", name, "act"), request("act"))
    assert all(not reply["ok"] for reply in replies)
    assert on_loopback.rig.done == before


def test_spoilt_messages_but_stops_change_nothing(on_loopback: Served, client: ZenohClient) -> None:
    """A seeded sample; benchmarks/remote_fuzz.py sends 10,000 to every key."""
    on_loopback.rig.hold_lease("eve")
    before = list(on_loopback.rig.done)
    rng = random.Random(5)
    kinds: dict[str, tuple[str, ...]] = {"ask": ("events", "check", "runs", "fetch")}
    kinds["cmd"] = tuple(verb for verb in ARGUMENTS if verb not in ("stop", "abort", "estop"))
    for kind, verbs in kinds.items():
        for verb in verbs:
            for payload in spoilt_payloads(rng, request(verb), 15):
                for reply in client.get(key(kind, "eve", verb), payload):
                    assert not reply["ok"] or kind == "ask", (verb, payload)
    assert on_loopback.rig.done == before
    assert "result" in client.ask(key("ask", "eve", "latest"), request("latest"))


def test_flood_delays_no_other_client(on_loopback: Served, client: ZenohClient) -> None:
    with on_loopback.client() as flooding:
        flooding.flood(key("ask", "mallory", "latest"), request("latest"), seconds=4.0)
        flooding.flood(key("cmd", "mallory", "pause"), b"{", seconds=4.0)
        for _ in range(10):
            assert "result" in client.ask(key("ask", "eve", "latest"), request("latest"))
            assert "result" in client.ask(key("stop", "eve", "stop"), request("stop"))
        assert client.ask(f"rigd/{RIG}/status", b"")["rig"] == RIG


def test_flood_is_refused_counted_and_named(on_loopback: Served) -> None:
    latest = key("ask", "mallory", "latest")
    expected = "mallory asks more than 100 questions a second"
    with on_loopback.client() as flooding:
        flooding.flood(latest, request("latest"), seconds=600.0)
        deadline = time.monotonic() + 60
        while (said := flooding.ask(latest, request("latest")).get("error", {})).get(
            "message"
        ) != expected:
            assert time.monotonic() < deadline
    assert said["code"] == "busy"
    assert on_loopback.server.refused().too_many > 0


def test_held_up_thread_delays_no_stop_of_others(on_loopback: Served, client: ZenohClient) -> None:
    """Three connections send what is refused, and the log of that hangs."""
    hangs = HangingLog()
    log = logging.getLogger("rigd.remote.server.refusal_log")
    with ExitStack() as opened:
        floods = [opened.enter_context(on_loopback.client()) for _ in range(3)]
        opened.callback(log.removeHandler, hangs)
        opened.callback(hangs.let_go.set)
        log.addHandler(hangs)
        for flood in floods:
            flood.flood(key("ask", "mallory", "nonsense"), b"{", seconds=2.0)
        assert hangs.begun.wait(60)
        time.sleep(2.0)  # of two threads none would be left
        for _ in range(5):
            assert "result" in client.ask(key("stop", "eve", "stop"), request("stop"))


def test_flood_of_requests_gets_part_of_processor(on_loopback: Served) -> None:
    name = f"remote-{Lane.ASK.value}"
    (lane,) = (item for item in threading.enumerate() if item.name == name)
    assert lane.ident is not None
    computed = time.pthread_getcpuclockid(lane.ident)
    with on_loopback.client() as flooding, on_loopback.rig.hanging("latest"):
        # More wait than are computed here: the lane rests as long as a request waits.
        for number in range(8):
            flooding.flood(key("ask", f"mallory{number}", "latest"), request("latest"), seconds=0.0)
        assert on_loopback.rig.begun.wait(60)
        time.sleep(0.5)
        on_loopback.rig.computes_s = 0.005
        before_s, since_s = time.clock_gettime(computed), time.monotonic()
        on_loopback.rig.let_go.set()
        while (took_s := time.clock_gettime(computed) - before_s) < 0.1:
            time.sleep(0.01)
        on_loopback.rig.computes_s = 0.0
    assert took_s < 0.3 * (time.monotonic() - since_s)


def test_only_the_flooding_identity_waits(on_loopback: Served, client: ZenohClient) -> None:
    rig = on_loopback.rig
    with on_loopback.client() as flooding, rig.hanging("dry_run"):
        flooding.flood(key("cmd", "mallory", "dry_run"), request("dry_run"), seconds=0.0)
        assert rig.begun.wait(60)
        # One is under way: these fill every place that waits, before what comes behind them.
        flooding.flood(key("cmd", "mallory", "dry_run"), request("dry_run"), seconds=2.0)
        theirs = flooding.ask(key("cmd", "mallory", "dry_run"), request("dry_run"))
        assert theirs["error"]["code"] == "busy"
        asking = client.asking(key("cmd", "eve", "dry_run"), request("dry_run"))
        time.sleep(0.2)  # an answer that eve must wait is here by then
        rig.let_go.set()
        assert "result" in asking()


def test_frozen_subscriber_delays_no_other(on_loopback: Served, client: ZenohClient) -> None:
    """It is dropped, not waited for: with BLOCK, a put to it takes 5 s."""
    client.subscribe(f"rigd/{RIG}/live/*")
    with on_loopback.client() as frozen:
        frozen.subscribe(f"rigd/{RIG}/live/*")
        frozen.freeze()
        slowest_s = 0.0
        for _ in range(300):
            with witnessed() as lost_s:
                begun_s = time.monotonic()
                on_loopback.server.publisher.frame("wheel", b"\x00" * 60_000)
                slowest_s = max(slowest_s, time.monotonic() - begun_s - lost_s())
        assert slowest_s < 2.0
        # 18 MB are more than the buffers of a connection hold; the other one goes on receiving.
        before = client.received().get(f"rigd/{RIG}/live/wheel", 0)
        for _ in range(20):
            on_loopback.server.publisher.frame("wheel", b"\x00")
        assert client.received(least=before + 1, within_s=20)[f"rigd/{RIG}/live/wheel"] > before


def test_connection_ended_without_close_frees_place(on_loopback: Served) -> None:
    for _ in range(3):
        with on_loopback.client() as client:
            client.subscribe(f"rigd/{RIG}/status")
    with on_loopback.client() as client:
        assert client.alive("rigd/*/alive") == [f"rigd/{RIG}/alive"]
