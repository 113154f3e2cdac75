"""A session in another mode than client is refused, and the rig is commanded all the same."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress

import pytest
from support.daemon.served_rig import Served, key
from support.daemon.served_rig import request as message
from support.daemon.zenoh_client import Refused, ZenohClient, config

from rigd.remote.client.queries import rigs_alive
from rigd.remote.client.rigs.target import make_target
from rigd.remote.client.session import open_session

TIMEOUT_S = 60.0


def guest(served: Served, mode: str) -> ZenohClient:
    """A session in another mode than that of a client."""
    name = None if served.certificates is None else "alice"
    settings = config(served.endpoint, served.certificates, name)
    return ZenohClient(settings | {"mode": mode, "listen": {"endpoints": []}})


async def rigs_found(served: Served, tries: int) -> list[list[str]]:
    """What clients find that name no rig."""
    found = []
    for _ in range(tries):
        session = await asyncio.to_thread(open_session, make_target(None, served.endpoint))
        try:
            found.append(await rigs_alive(session))
        finally:
            await asyncio.to_thread(session.close)
    return found


@pytest.mark.parametrize("mode", ["peer", "router"])
def test_peer_or_router_session_is_disconnected(on_loopback: Served, mode: str) -> None:
    transports = on_loopback.server.transports
    with suppress(Refused), guest(on_loopback, mode):
        deadline = time.monotonic() + TIMEOUT_S
        while set(transports()) - {"client"}:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        assert asyncio.run(rigs_found(on_loopback, 10)) == [["lugre-1"]] * 10


@pytest.mark.parametrize("mode", ["peer", "router"])
@pytest.mark.parametrize("served", ["on_loopback", "over_tls"])
def test_session_in_another_mode_reaches_nothing(
    request: pytest.FixtureRequest, served: str, mode: str
) -> None:
    rig: Served = request.getfixturevalue(served)
    with rig.client("alice" if rig.certificates else None) as client:
        client.subscribe("rigd/lugre-1/*")
        with suppress(Refused), guest(rig, mode) as other:
            other.put("rigd/lugre-1/event", b"FAKE")
            other.answer_queries("rigd/lugre-1/ask/*/*")
            other.pretend("rigd/lugre-9/alive")
            for _ in range(5):
                reply = client.ask(key("ask", "alice", "latest"), message("latest"))
                assert "values" in reply["result"]
            assert client.alive("rigd/*/alive") in ([], ["rigd/lugre-1/alive"])
        assert "rigd/lugre-1/event" not in client.received()
