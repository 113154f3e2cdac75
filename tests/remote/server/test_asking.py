"""Work that is done for a client ends with it."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator

import pytest
from support.recorded_rig import RecordedRig
from support.served_rig import free_port, key, request

from rigd.config.remote import RemoteSetup
from rigd.remote.client.session import open_session, query
from rigd.remote.client.target import make_target
from rigd.remote.protocol import Message, Role
from rigd.remote.server import Lease, Result, Server, still_connected

TIMEOUT_S = 60.0


class Calculating(RecordedRig):
    """Calculates for as long as its client is there."""

    def __init__(self, lease: Lease) -> None:
        super().__init__("lugre-1", lease)
        self.begun_with_client = threading.Event()
        self.client_gone = threading.Event()

    def ask(self, identity: str, role: Role, what: str, args: Message) -> Result:
        deadline = time.monotonic() + TIMEOUT_S
        while still_connected() and time.monotonic() < deadline:
            self.begun_with_client.set()
            time.sleep(0.01)
        if not still_connected():
            self.client_gone.set()
        return {}


@pytest.fixture
def served() -> Iterator[tuple[Calculating, str]]:
    setup = RemoteSetup((f"tcp/127.0.0.1:{free_port()}",))
    lease = Lease(lambda name: True)
    with Server("lugre-1", setup, lease) as server:
        rig = Calculating(lease)
        server.start(rig)
        yield rig, setup.listen[0]


def test_a_client_that_leaves_is_known_to_be_gone(served: tuple[Calculating, str]) -> None:
    rig, endpoint = served

    async def ask_and_leave() -> None:
        session = await asyncio.to_thread(open_session, make_target("lugre-1", endpoint))
        asking = asyncio.create_task(
            query(session, key("ask", "eve", "check"), TIMEOUT_S, request("check"))
        )
        assert await asyncio.to_thread(rig.begun_with_client.wait, TIMEOUT_S)
        asking.cancel()
        await asyncio.to_thread(session.close)

    asyncio.run(ask_and_leave())
    assert rig.client_gone.wait(TIMEOUT_S)
