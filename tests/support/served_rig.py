"""A rig that is served on a free port, and requests to it written by hand."""

from __future__ import annotations

import hashlib
import json
import secrets
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from support.recorded_rig import RecordedRig
from support.zenoh_client import ZenohClient, config

from rigd.config.remote import RemoteSetup
from rigd.remote.server import Lease, Server

RIG = "lugre-1"

_TEXT = "procedure: one"
_PROCEDURE = {"name": "one", "text": _TEXT, "sha256": hashlib.sha256(_TEXT.encode()).hexdigest()}

#: Arguments that each verb takes; none where it is not named.
ARGUMENTS: dict[str, dict[str, Any]] = {
    "events": {"seq": 0},
    "history": {"stream": "wheel"},
    "procedure": {"name": "one"},
    "check": {"procedure": _PROCEDURE, "set": {"floor": "pvc"}},
    "runs": {"limit": 10},
    "run": {"run": "a.mcap"},
    "report": {"run": "a.mcap", "offset": 0, "length": 100},
    "fetch": {"run": "a.mcap", "offset": 0, "length": 100},
    "lease_give": {"to": "alice"},
    "start": {"procedure": _PROCEDURE, "set": {}, "seed": 1, "answers": "ask"},
    "answer": {"prompt_id": 1, "value": 0.5},
    "acknowledge": {"interlock": "overrun"},
    "resume_run": {"run": "a.mcap"},
    "identify": {"run": "a.mcap"},
    "draw": {"run": "a.mcap"},
    "dry_run": {"procedure": _PROCEDURE, "set": {}},
    "act": {"device": "scale", "action": "tare"},
    "stop": {"reason": "lunch"},
    "abort": {"reason": ""},
    "estop": {"reason": ""},
}


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
    rig: RecordedRig
    endpoint: str
    certificates: Path | None = None

    def client(self, name: str | None = None) -> ZenohClient:
        """Return a session in a process of its own; with TLS, by the certificate of ``name``."""
        return ZenohClient(config(self.endpoint, self.certificates, name))


def free_port() -> int:
    """A port of the loopback that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def serve(setup: RemoteSetup, certificates: Path | None = None) -> Iterator[Served]:
    """Serve a rig that only notes what it is asked."""
    lease = Lease(lambda name: True)
    with Server(RIG, setup, lease) as server:
        rig = RecordedRig(RIG, lease)
        server.start(rig)
        yield Served(server, rig, setup.listen[0], certificates)
