"""What a client reports and does without an answer, and once one comes again."""

from __future__ import annotations

import asyncio
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from support.daemon.served_rig import free_port, serve
from support.panel.played_rig import PlayedRig

from rigd.config.remote import RemoteSetup
from rigd.model.errors import LinkError
from rigd.remote import AsyncClient, Client
from rigd.remote.client import connection
from rigd.remote.client.connection import Connection
from rigd.remote.client.rigs.target import make_target
from rigd.remote.protocol import Kind, LeaseView
from rigd.remote.tls import SERVER, files_of, setup_tls

#: Serves a rig in a process of its own, which can be killed and frozen; a dry run takes for ever.
SERVE = """
import sys
from support.daemon.served_rig import serve
from rigd.config.remote import RemoteSetup
with serve(RemoteSetup((sys.argv[1],))) as served, served.rig.hanging("dry_run"):
    print("serving", flush=True)
    sys.stdin.read()
"""


@contextmanager
def process(endpoint: str) -> Iterator[subprocess.Popen[str]]:
    tests = str(Path(__file__).parents[2])
    done = subprocess.Popen(
        [sys.executable, "-c", SERVE, endpoint],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={"PYTHONPATH": tests, "PATH": ""},
    )
    try:
        assert done.stdout is not None and done.stdout.readline() == "serving\n"
        yield done
    finally:
        done.send_signal(signal.SIGCONT)
        done.kill()
        done.communicate()


@pytest.fixture
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


def test_address_without_daemon_is_reported_with_remedy(endpoint: str) -> None:
    with pytest.raises(LinkError, match=rf"{endpoint}\n.*rigd serve"):
        Client("lugre-1", endpoint=endpoint)


def test_dead_daemon_is_reported_restarted_daemon_found(endpoint: str) -> None:
    with process(endpoint) as first, Client(endpoint=endpoint) as rig:
        first.kill()
        first.wait()
        with pytest.raises(LinkError, match=r"is lost|is not known"):  # noticed already, or not
            rig.stop()
        with process(endpoint):
            deadline_s = time.monotonic() + 60
            while time.monotonic() < deadline_s:
                try:
                    rig.stop()
                    break
                except LinkError:
                    continue
            assert rig.status().rig == "lugre-1"
            statuses = rig.watch(patience_s=60)
            assert next(statuses).rig == "lugre-1"


def test_watching_continues_with_a_restarted_daemon(endpoint: str) -> None:
    with process(endpoint) as first, Client(endpoint=endpoint) as rig:
        statuses = rig.watch(patience_s=None)
        pid = next(statuses).daemon.pid
        first.kill()
        first.wait()
        with process(endpoint):
            assert next(status.daemon.pid for status in statuses if status.daemon.pid != pid) != pid


def test_silence_is_reported_to_a_watching_client(endpoint: str) -> None:
    with process(endpoint) as daemon, Client(endpoint=endpoint) as rig:
        statuses = rig.watch(patience_s=1.0)
        next(statuses)
        daemon.send_signal(signal.SIGSTOP)
        with pytest.raises(LinkError, match="has sent no message for 1 s"):
            for _ in statuses:
                pass


def test_silent_daemon_is_not_waited_for_indefinitely(
    endpoint: str,
) -> None:
    async def ask() -> None:
        async with AsyncClient(endpoint=endpoint) as rig:
            asking = asyncio.create_task(rig.dry_run("quick"))  # which takes for ever there
            await asyncio.sleep(0)
            await rig.describe()  # answered behind the other request: that one is there
            assert not asking.done()
            daemon.send_signal(signal.SIGSTOP)
            with pytest.raises(LinkError, match="not known"):
                await asyncio.wait_for(asking, 40)

    with process(endpoint) as daemon:
        asyncio.run(ask())


def test_daemon_lost_between_attempts_leaves_outcome_unknown(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with serve(RemoteSetup((endpoint,))) as found, Client(endpoint=endpoint) as rig:
        found.server.close()
        monkeypatch.setattr(connection, "is_connected", lambda session: True)  # not yet noticed
        with pytest.raises(LinkError, match=r"stop .*not known"):
            rig.stop()


def test_a_request_sent_again_acts_once(endpoint: str) -> None:
    async def ask() -> int:
        async with await Connection.open(make_target(endpoint=endpoint, identity="alice")) as rig:
            await rig.request(Kind.COMMAND, "lease_take", {}, LeaseView)
            payload = (
                b'{"v":1,"id":"%b","sent_ns":%d,"args":{}}'
                % (secrets.token_hex(16).encode(), time.time_ns())
            )  # fmt: skip
            first = await rig._insist(Kind.COMMAND, "pause", payload)
            again = await rig._insist(Kind.COMMAND, "pause", payload)
            assert first == again
            return found.rig.verbs().count("pause")

    with serve(RemoteSetup((endpoint,))) as found:
        assert asyncio.run(ask()) == 1


def test_each_tls_refusal_names_what_to_check(tmp_path: Path) -> None:
    certificates, foreign = tmp_path / "certificates", tmp_path / "foreign"
    setup_tls(certificates, ["127.0.0.1"], ["alice", "bob", "mallory"])
    setup_tls(foreign, ["127.0.0.1"], ["alice"])
    endpoint = f"tls/127.0.0.1:{free_port()}"
    setup = RemoteSetup(
        (endpoint,), files_of(certificates, SERVER), {"alice": "operator", "bob": "observer"}
    )
    with serve(setup, rig=PlayedRig("wire-1")) as found:
        with Client(endpoint=endpoint, tls=files_of(certificates, "alice")) as alice:
            assert alice.identity == "alice"
            with alice.control():
                alice.pause()
        with Client("wire-1", endpoint=endpoint, tls=files_of(certificates, "bob")) as bob:
            bob.stop()
            with pytest.raises(LinkError, match=r"takes no lease take from bob\n.*role"):
                bob.lease_take()
        with pytest.raises(LinkError, match=r"(?s)no daemon of wire-1 .*mallory"):
            Client("wire-1", endpoint=endpoint, tls=files_of(certificates, "mallory"))
        with pytest.raises(LinkError, match=r"(?s)no rig at.*mallory .*role"):
            Client(endpoint=endpoint, tls=files_of(certificates, "mallory"))
        with pytest.raises(LinkError, match=r"(?s)admits this client.*foreign/ca\.crt"):
            Client("wire-1", endpoint=endpoint, tls=files_of(foreign, "alice"))
        assert found.rig.verbs() == ["lease_take", "pause", "lease_release", "stop"]


def test_client_that_is_never_closed_keeps_no_process(endpoint: str) -> None:
    script = (
        "import sys; from rigd.remote import Client; rig = Client(endpoint=sys.argv[1]);"
        "statuses = rig.watch(); print(next(statuses).rig)"
    )
    with serve(RemoteSetup((endpoint,))):
        done = subprocess.run(
            [sys.executable, "-c", script, endpoint],
            capture_output=True, text=True, timeout=60, check=True,
        )  # fmt: skip
    assert (done.stdout, done.stderr) == ("lugre-1\n", "")


#: Prints, when Python ends, whether all sessions of zenoh are closed: a thread of zenoh that calls
#: Python later than that aborts the process, now and then.
UNCLOSED = """
import atexit, sys, zenoh
opened, sessions = zenoh.open, []
zenoh.open = lambda config: sessions.append(opened(config)) or sessions[-1]
atexit.register(lambda: print([session.is_closed() for session in sessions]))
from rigd.remote import Client
rig = Client(endpoint=sys.argv[1])
statuses = rig.watch()
next(statuses)
"""


def test_client_never_closed_disconnects_before_python_ends(endpoint: str) -> None:
    with serve(RemoteSetup((endpoint,))):
        done = subprocess.run(
            [sys.executable, "-c", UNCLOSED, endpoint],
            capture_output=True, text=True, timeout=60, check=True,
        )  # fmt: skip
    assert done.stdout == "[True]\n"
