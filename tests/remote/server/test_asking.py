"""Work that is done for a client ends with it."""

from __future__ import annotations

import asyncio
import threading
import time

from support.daemon.served_rig import key, request, serve
from support.panel.played_rig import PlayedRig

from rigd.remote.client.queries import query
from rigd.remote.client.rigs.target import make_target
from rigd.remote.client.session import open_session
from rigd.remote.protocol import Message, Requester, Verb
from rigd.remote.server import still_connected

TIMEOUT_S = 60.0


class Calculating(PlayedRig):
    """Calculates for as long as its client is there."""

    def __init__(self) -> None:
        super().__init__()
        self.begun_with_client = threading.Event()
        self.client_gone = threading.Event()

    def answer(self, verb: Verb, requester: Requester, args: Message) -> Message:
        deadline = time.monotonic() + TIMEOUT_S
        while still_connected() and time.monotonic() < deadline:
            self.begun_with_client.set()
            time.sleep(0.01)
        if not still_connected():
            self.client_gone.set()
        return super().answer(verb, requester, args)


def test_disconnected_client_is_noticed() -> None:
    rig = Calculating()

    async def ask_and_leave(endpoint: str) -> None:
        session = await asyncio.to_thread(open_session, make_target("lugre-1", endpoint))
        asking = asyncio.create_task(
            query(session, key("ask", "eve", "check"), TIMEOUT_S, request("check"))
        )
        assert await asyncio.to_thread(rig.begun_with_client.wait, TIMEOUT_S)
        asking.cancel()
        await asyncio.to_thread(session.close)

    with serve(rig=rig) as served:
        asyncio.run(ask_and_leave(served.endpoint))
        assert rig.client_gone.wait(TIMEOUT_S)
