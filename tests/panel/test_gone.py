"""What a page asked for ends with the page."""

from __future__ import annotations

import http.client
import json
import threading
import time

from support.daemon.served_rig import ARGUMENTS
from support.panel.played_rig import PlayedRig
from support.panel.served import ServedPanel

from rigd.remote.protocol import Message, Requester, Verb
from rigd.remote.server import still_connected

TIMEOUT_S = 60.0


class Calculating(PlayedRig):
    """Plays a dry run for as long as its client is there."""

    def __init__(self) -> None:
        super().__init__()
        self.begun_with_client = threading.Event()
        self.client_gone = threading.Event()

    def answer(self, verb: Verb, requester: Requester, args: Message) -> Message:
        deadline = time.monotonic() + TIMEOUT_S
        while verb.name == "dry_run" and time.monotonic() < deadline:
            if not still_connected():
                self.client_gone.set()
                break
            self.begun_with_client.set()
            time.sleep(0.01)
        return super().answer(verb, requester, args)


def test_dry_run_ends_with_the_page() -> None:
    rig = Calculating()
    with ServedPanel(rig) as panel:
        visitor = panel.visitor()
        page = http.client.HTTPConnection("127.0.0.1", panel.port, timeout=TIMEOUT_S)
        headers = {"origin": panel.origin, "x-rigd": "1", "cookie": visitor.cookie}
        body = json.dumps({"args": ARGUMENTS["dry_run"]})
        page.request(
            "POST", "/api/command/dry_run", body, headers | {"content-type": "application/json"}
        )
        assert rig.begun_with_client.wait(TIMEOUT_S)
        assert not rig.client_gone.is_set()
        page.close()
        assert rig.client_gone.wait(TIMEOUT_S)
        assert visitor.post("/api/ask/lease", args={})[0] in (200, 404)  # the panel serves on
