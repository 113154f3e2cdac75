"""The life of a server: one at an address, seen while it lives, gone once closed."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest
from support.daemon.served_rig import RIG, Served, free_port, key, request, serve
from support.daemon.zenoh_client import Refused, ZenohClient, config
from support.panel.played_rig import PlayedRig

from rigd.config.remote import RemoteSetup, TlsFiles
from rigd.model import ConfigError, LinkError
from rigd.remote.protocol import RigEvent, Status
from rigd.remote.protocol.limits import VERSION
from rigd.remote.server import Lease, Server


def setup() -> RemoteSetup:
    return RemoteSetup((f"tcp/127.0.0.1:{free_port()}",))


def test_a_second_daemon_does_not_get_the_address() -> None:
    taken = setup()
    with serve(taken), pytest.raises(LinkError, match="another program listens there") as caught:
        Server(RIG, taken, Lease())
    assert "a port each" in str(caught.value.hint)


def test_foreign_address_is_reported_without_zenoh_source() -> None:
    elsewhere = RemoteSetup(("tcp/192.0.2.1:7447",))  # for documentation (RFC 5737)
    with pytest.raises(LinkError, match=r"cannot listen on tcp/192\.0\.2\.1:7447") as caught:
        Server(RIG, elsewhere, Lease())
    assert ".rs:" not in str(caught.value)


def test_missing_certificates_are_reported(tmp_path: Path) -> None:
    files = TlsFiles(tmp_path / "ca.crt", tmp_path / "rigd.crt", tmp_path / "rigd.key")
    listening = RemoteSetup((f"tls/127.0.0.1:{free_port()}",), files, {"alice": "operator"})
    with pytest.raises(ConfigError, match=r"rigd\.crt cannot be read: No such file") as caught:
        Server(RIG, listening, Lease())
    assert "setup-tls" in str(caught.value.hint)


def own_sockets() -> set[str]:
    """Listening addresses of this process: protocol and address, as proc_pid_net(5) writes them."""
    mine = set()
    for item in Path("/proc/self/fd").iterdir():
        with suppress(FileNotFoundError):  # the one that lists them
            mine.add(str(item.readlink()))
    found = set()
    for protocol in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path(f"/proc/self/net/{protocol}").read_text().splitlines()[1:]:
            _, local, _, state, *rest = line.split()
            listens = state == "0A" or protocol.startswith("udp")
            if listens and f"socket:[{rest[5]}]" in mine:
                found.add(f"{protocol} {local}")
    return found


def test_server_listens_only_on_its_addresses() -> None:
    """By itself zenoh listens on every interface, joins a multicast group and shares memory."""
    listening, before = setup(), own_sockets()
    port = int(listening.listen[0].rpartition(":")[2])
    with Server(RIG, listening, Lease()) as server:
        assert own_sockets() - before == {f"tcp 0100007F:{port:04X}"}
        server.publisher.frame("wheel", bytes(60_000))  # memory would be shared from 3 KiB on
        assert not list(Path("/dev/shm").glob("*zenoh*"))


def test_nothing_is_answered_before_it_is_started() -> None:
    listening, rig = setup(), PlayedRig()
    server = Server(RIG, listening, rig.lease)
    with server, ZenohClient(config(listening.listen[0])) as client:
        assert client.alive("rigd/*/alive") == []
        assert client.get(key("ask", "eve", "latest"), request("latest")) == []
        server.start(rig)
        assert client.alive("rigd/*/alive") == [f"rigd/{RIG}/alive"]
        assert "result" in client.ask(key("ask", "eve", "latest"), request("latest"))


def test_closed_server_is_gone_and_frees_its_address() -> None:
    listening = setup()
    with serve(listening) as served:
        client = served.client()
    with client:
        assert client.alive("rigd/*/alive") == []
        assert client.get(key("ask", "eve", "latest"), request("latest")) == []
    with pytest.raises(Refused):
        ZenohClient(config(listening.listen[0]))
    with serve(listening) as served, served.client() as again:
        assert again.alive("rigd/*/alive") == [f"rigd/{RIG}/alive"]


def test_a_late_joiner_gets_the_newest_status(on_loopback: Served) -> None:
    with on_loopback.client() as client:
        first = client.ask(f"rigd/{RIG}/status", b"")
        client.subscribe(f"rigd/{RIG}/status")
        client.received(least=2, within_s=20)
        second = client.ask(f"rigd/{RIG}/status", b"")
    assert second["seq"] > first["seq"]


def test_event_and_frame_reach_subscribers(on_loopback: Served) -> None:
    with on_loopback.client() as client:
        client.subscribe(f"rigd/{RIG}/event")
        client.subscribe(f"rigd/{RIG}/live/*")
        client.ask(f"rigd/{RIG}/status", b"")  # by then the subscriptions have arrived
        on_loopback.server.publisher.event(RigEvent(v=VERSION, seq=1, t_ns=1, kind="trip"))
        on_loopback.server.publisher.frame("wheel", b"frame")
        came = client.received(least=2, within_s=20)
    assert came == {f"rigd/{RIG}/event": 1, f"rigd/{RIG}/live/wheel": 1}


def test_hanging_lane_is_reported(on_loopback: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigd.remote.server.server._STUCK_S", 0.0)
    with on_loopback.client() as client, on_loopback.rig.hanging("stop"):
        asking = client.asking(key("stop", "eve", "stop"), request("stop"))
        assert on_loopback.rig.begun.wait(60)
        assert on_loopback.server.hangs == "remote-stop has not answered for 0 s"
        on_loopback.rig.let_go.set()
        assert "result" in asking()
    deadline = time.monotonic() + 20
    while on_loopback.server.hangs:  # it has replied, and is about to take the next
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.parametrize("verb", ["dry_run", "pause"])
def test_stop_overtakes_a_long_request(on_loopback: Served, verb: str) -> None:
    rig = on_loopback.rig
    rig.hold_lease("eve")
    with on_loopback.client() as client, on_loopback.client() as other, rig.hanging(verb):
        asking = client.asking(key("cmd", "eve", verb), request(verb))
        assert rig.begun.wait(60)
        assert on_loopback.server.hangs == ""
        assert "result" in other.ask(key("stop", "bob", "stop"), request("stop"))
        assert "result" in other.ask(key("cmd", "eve", "lease_renew"), request("lease_renew"))
        assert not rig.let_go.is_set()
        rig.let_go.set()
        assert "result" in asking()


class Sick(PlayedRig):
    """Fails to report its status from the second time on, until it is repaired."""

    def __init__(self) -> None:
        super().__init__()
        self.failed = threading.Event()
        self.well = threading.Event()

    def status(self) -> Status:
        """Return the first, fail at the next."""
        if self.said and not self.well.is_set():
            self.failed.set()
            raise RuntimeError("no status")
        return super().status()


def test_rig_without_status_falls_silent_and_returns(
    caplog: pytest.LogCaptureFixture,
) -> None:
    listening, rig = setup(), Sick()
    server = Server(RIG, listening, rig.lease)
    with server, ZenohClient(config(listening.listen[0])) as client, caplog.at_level("ERROR"):
        server.start(rig)
        client.subscribe(f"rigd/{RIG}/status")
        assert rig.failed.wait(20)
        assert client.ask(f"rigd/{RIG}/status", b"")["seq"] == 1
        rig.well.set()
        client.received(least=2, within_s=20)
        assert client.ask(f"rigd/{RIG}/status", b"")["seq"] > 1
    assert "the status cannot be published" in caplog.text
