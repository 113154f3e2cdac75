"""What a client says and does where nobody answers, and once somebody does again."""

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
from support.answering_rig import served
from support.served_rig import free_port

from rigd.config.remote import RemoteSetup
from rigd.model.errors import LinkError
from rigd.remote import AsyncClient, Client
from rigd.remote.client import Connection, connection, make_target
from rigd.remote.protocol import Kind
from rigd.remote.tls import SERVER, files_of, setup_tls

#: Serves an answering rig in a process of its own, which can be killed and frozen.
SERVE = """
import sys, time
from support.answering_rig import served
from rigd.config.remote import RemoteSetup
with served("lugre-1", RemoteSetup((sys.argv[1],))) as one:
    one.rig.slow_s = 60.0
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


def test_nobody_at_an_address_is_told_with_what_to_look_at(endpoint: str) -> None:
    with pytest.raises(LinkError, match=rf"nobody lets us in at {endpoint}\n.*rigd serve"):
        Client("lugre-1", endpoint=endpoint)


def test_a_daemon_that_died_is_told_and_one_that_is_back_is_found(endpoint: str) -> None:
    with process(endpoint) as first, Client(endpoint=endpoint) as rig:
        first.kill()
        first.wait()
        with pytest.raises(LinkError, match="is lost"):
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


def test_watching_goes_on_with_a_daemon_that_was_started_anew(endpoint: str) -> None:
    with process(endpoint) as first, Client(endpoint=endpoint) as rig:
        statuses = rig.watch(patience_s=None)
        pid = next(statuses).daemon.pid
        first.kill()
        first.wait()
        with process(endpoint):
            assert next(status.daemon.pid for status in statuses if status.daemon.pid != pid) != pid


def test_a_silence_is_told_to_who_watches(endpoint: str) -> None:
    with process(endpoint) as daemon, Client(endpoint=endpoint) as rig:
        statuses = rig.watch(patience_s=1.0)
        next(statuses)
        daemon.send_signal(signal.SIGSTOP)
        with pytest.raises(LinkError, match="has said nothing for 1 s"):
            for _ in statuses:
                pass


def test_a_daemon_that_falls_silent_is_not_waited_for_however_long_it_may_take(
    endpoint: str,
) -> None:
    async def ask() -> None:
        async with AsyncClient(endpoint=endpoint) as rig:
            asking = asyncio.create_task(rig.dry_run("small"))  # which takes a minute there
            await asyncio.sleep(0)
            await rig.describe()  # answered behind the other request: that one is there
            assert not asking.done()
            daemon.send_signal(signal.SIGSTOP)
            with pytest.raises(LinkError, match="not known"):
                await asyncio.wait_for(asking, 40)

    with process(endpoint) as daemon:
        asyncio.run(ask())


def test_a_daemon_that_leaves_between_two_attempts_leaves_a_doubt(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with served(setup=RemoteSetup((endpoint,))) as found, Client(endpoint=endpoint) as rig:
        found.server.close()
        monkeypatch.setattr(connection, "is_connected", lambda session: True)  # not yet noticed
        with pytest.raises(LinkError, match="whether stop was carried out is not known"):
            rig.stop()


def test_a_request_sent_again_acts_once(endpoint: str) -> None:
    async def ask() -> int:
        async with await Connection.open(make_target(endpoint=endpoint, identity="alice")) as rig:
            await rig.command("lease_take", {})
            payload = (
                b'{"v":1,"id":"%b","sent_ns":%d,"args":{}}'
                % (secrets.token_hex(16).encode(), time.time_ns())
            )  # fmt: skip
            first = await rig._insist(Kind.COMMAND, "pause", payload)
            again = await rig._insist(Kind.COMMAND, "pause", payload)
            assert first == again
            return [verb for _, verb, _ in found.rig.done].count("pause")

    with served(setup=RemoteSetup((endpoint,))) as found:
        assert asyncio.run(ask()) == 1


def test_over_tls_each_reason_to_be_left_outside_says_what_to_look_at(tmp_path: Path) -> None:
    certificates, foreign = tmp_path / "certificates", tmp_path / "foreign"
    setup_tls(certificates, ["127.0.0.1"], ["alice", "bob", "mallory"])
    setup_tls(foreign, ["127.0.0.1"], ["alice"])
    endpoint = f"tls/127.0.0.1:{free_port()}"
    setup = RemoteSetup(
        (endpoint,), files_of(certificates, SERVER), {"alice": "operator", "bob": "observer"}
    )
    with served("wire-1", setup) as found:
        with Client(endpoint=endpoint, tls=files_of(certificates, "alice")) as alice:
            assert alice.identity == "alice"
            with alice.control():
                alice.pause()
        with Client("wire-1", endpoint=endpoint, tls=files_of(certificates, "bob")) as bob:
            bob.stop()
            with pytest.raises(LinkError, match=r"takes no lease take from bob\n.*role"):
                bob.lease_take()
        with pytest.raises(LinkError, match=r"(?s)no daemon of wire-1 answers.*mallory also needs"):
            Client("wire-1", endpoint=endpoint, tls=files_of(certificates, "mallory"))
        with pytest.raises(LinkError, match=r"(?s)there is no rig at.*mallory also needs a role"):
            Client(endpoint=endpoint, tls=files_of(certificates, "mallory"))
        with pytest.raises(LinkError, match=r"(?s)nobody lets us in.*trust .*foreign/ca\.crt"):
            Client("wire-1", endpoint=endpoint, tls=files_of(foreign, "alice"))
        assert found.rig.verbs() == ["lease_take", "pause", "lease_release", "stop"]


def test_a_client_that_is_never_closed_keeps_no_process(endpoint: str) -> None:
    script = (
        "import sys; from rigd.remote import Client; rig = Client(endpoint=sys.argv[1]);"
        "statuses = rig.watch(); print(next(statuses).rig)"
    )
    with served(setup=RemoteSetup((endpoint,))):
        done = subprocess.run(
            [sys.executable, "-c", script, endpoint],
            capture_output=True, text=True, timeout=60, check=True,
        )  # fmt: skip
    assert (done.stdout, done.stderr) == ("lugre-1\n", "")
