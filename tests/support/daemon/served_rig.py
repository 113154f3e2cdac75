"""A played rig that is served on a free port, and requests to it written by hand."""

from __future__ import annotations

import json
import secrets
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zenoh
from support.daemon.zenoh_client import ZenohClient, config
from support.panel.played_campaign import FILE, past_runs
from support.panel.played_rig import PlayedRig

from rigd.config.remote import RemoteSetup
from rigd.remote.network import open_server
from rigd.remote.protocol import as_json
from rigd.remote.server import Server

RIG = "lugre-1"

_PROCEDURE = as_json(FILE)
_RUN = past_runs()[1].run  # which has all that can be made of a recording

#: Arguments that each verb takes; none if it is not named.
ARGUMENTS: dict[str, dict[str, Any]] = {
    "events": {"seq": 0},
    "history": {"stream": "carriage"},
    "procedure": {"name": FILE.name},
    "check": {"procedure": _PROCEDURE, "set": {"floor": "pvc"}},
    "runs": {"limit": 10},
    "run": {"run": _RUN},
    "report": {"run": _RUN, "offset": 0, "length": 100},
    "fetch": {"run": _RUN, "offset": 0, "length": 100},
    "compare": {"runs": [_RUN, _RUN], "offset": 0, "length": 100},
    "lease_give": {"to": "alice"},
    "start": {"procedure": _PROCEDURE, "set": {}, "seed": 1, "answers": "ask"},
    "answer": {"prompt_id": 1, "value": 0.5},
    "acknowledge": {"interlock": "overrun"},
    "resume_run": {"run": _RUN},
    "identify": {"run": _RUN},
    "calibrate": {"run": _RUN, "days": 365, "write": False},
    "draw": {"run": _RUN},
    "dry_run": {"procedure": _PROCEDURE, "set": {}},
    "act": {"device": "scale", "action": "tare"},
    "stop": {"reason": "lunch"},
    "abort": {"reason": ""},
    "estop": {"reason": ""},
}


def _use_settings_of_daemon() -> None:
    """Let zenoh have as many threads in this process as in a daemon's.

    zenoh reads the number at its first use in a process. A client that a test opened first would
    leave the servers of all later tests with two threads.
    """
    alone = {"mode": "peer", "listen": {"endpoints": []}, "connect": {"endpoints": []}}
    scouting = {"multicast": {"enabled": False}, "gossip": {"enabled": False}}
    open_server(zenoh.Config.from_json5(json.dumps(alone | {"scouting": scouting}))).close()


_use_settings_of_daemon()


def key(kind: str, identity: str, verb: str) -> str:
    """The key of a request."""
    return f"rigd/{RIG}/{kind}/{identity}/{verb}"


def request(verb: str, **changes: Any) -> bytes:
    """The bytes of a new request for ``verb``, with some keys of the message replaced."""
    message = {
        "v": 1,
        "id": secrets.token_hex(16),
        "sent_ns": time.time_ns(),
        "args": ARGUMENTS.get(verb, {}),
    }
    return json.dumps(message | changes).encode()


@dataclass
class Served:
    """A rig that is served, and what a client needs to reach it."""

    server: Server
    rig: PlayedRig
    endpoint: str
    certificates: Path | None = None

    def client(self, name: str | None = None) -> ZenohClient:
        """Return a session in a process of its own; with TLS, by the certificate of ``name``."""
        return ZenohClient(config(self.endpoint, self.certificates, name))


def free_port() -> int:
    """A port of the loopback without a listener."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def serve(
    setup: RemoteSetup | None = None,
    certificates: Path | None = None,
    *,
    rig: PlayedRig | None = None,
    live: bool = False,
) -> Iterator[Served]:
    """Serve a played rig, by default on a free port; ``live``: its run moves, and shows frames."""
    setup = setup or RemoteSetup((f"tcp/127.0.0.1:{free_port()}",))
    rig = rig or PlayedRig(RIG)
    closing = threading.Event()
    with Server(rig.name, setup, rig.lease) as server:
        rig.publisher = server.publisher
        server.start(rig)
        playing = threading.Thread(target=rig.play, args=(closing,), name="played rig")
        if live:
            playing.start()
        try:
            yield Served(server, rig, setup.listen[0], certificates)
        finally:
            closing.set()
            if live:
                playing.join()
            rig.publisher = None
