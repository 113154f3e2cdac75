"""Requests to the panel that no page of ours sends: spoilt bodies, paths and headers."""

from __future__ import annotations

import json
import random
import string
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from support.panel.served import ServedPanel, Visitor

from rigd.panel import guard
from rigd.remote.request_rates import Bucket

GETS = ("/", "/static/js/main.js", "/api/session", "/api/run/x/report", "/api/run/x/recording")
POSTS = (
    "/api/login", "/api/logout", "/api/invite", "/api/ask/describe", "/api/ask/run",
    "/api/command/start", "/api/command/answer", "/api/command/lease_give", "/api/stop/stop",
)  # fmt: skip
DOORS = [*(("GET", path) for path in GETS), *(("POST", path) for path in POSTS)]


def let_a_flood_through(patch: pytest.MonkeyPatch) -> None:
    """Take the rates away, so that everything behind them is reached."""
    patch.setattr(guard, "PER_S", 1e6)
    patch.setattr(guard, "BURST", 1e6)
    patch.setattr(Bucket, "take", lambda self: True)


@contextmanager
def in_control(panel: ServedPanel, host: Visitor) -> Iterator[Visitor]:
    """A user who has control, so that a request is refused for its content alone."""
    visitor = Visitor(panel)
    visitor.login(host.post("/api/invite", role="operator")[1]["code"], "Mallory")
    with visitor.page():
        deadline = time.monotonic() + 30  # one whom a wild request logged out still has control
        while visitor.post("/api/command/lease_take", args={})[0] != 200:
            assert time.monotonic() < deadline
            time.sleep(0.1)
        yield visitor
        visitor.post("/api/command/lease_release", args={})


def send_wild(random_: random.Random, visitor: Visitor, method: str, known: str) -> tuple[int, Any]:
    """Send one request; return its status and all of it, 0 if it was cut off."""
    wild: dict[str, str | None] = {}
    if random_.random() < 0.2:
        name = random_.choice(["origin", "x-rigd", "content-type", "content-length", "cookie"])
        wild[name] = random_.choice([None, "", "x", "\xff", "1" * 40])
    sent = body(random_) if method == "POST" else b""
    where = path(random_, known)
    try:
        status, _, answer = visitor.send(method, where, sent, **wild)
    except OSError:
        status, answer = 0, b""  # what is no HTTP at all may be cut off
    return status, (where, sent, wild, answer)


def something(random_: random.Random, depth: int = 0) -> Any:
    """Return a random piece of JSON."""
    kind = random_.randrange(9 if depth < 4 else 6)
    if kind == 0:
        return random_.choice([None, True, False])
    if kind == 1:
        return random_.choice([0, -1, 2**63, 10**400, 1.5, -0.0])
    if kind < 6:
        return text(random_)
    if kind == 6:
        return [something(random_, depth + 1) for _ in range(random_.randrange(4))]
    return {text(random_): something(random_, depth + 1) for _ in range(random_.randrange(4))}


def text(random_: random.Random) -> str:
    known = (
        "args", "code", "name", "role", "operator", "session", "client", "to", "run", "value",
        "procedure", "set", "prompt_id", "../../etc/passwd", "\x00", "ü", "\ud800", "",
    )  # fmt: skip
    if random_.random() < 0.7:
        return random_.choice(known)
    return "".join(random_.choices(string.printable, k=random_.randrange(30)))


def body(random_: random.Random) -> bytes:
    match random_.randrange(6):
        case 0:
            return random_.randbytes(random_.randrange(200))
        case 1:
            return b"[" * random_.randrange(60_000)
        case 2:
            whole = json.dumps({"args": something(random_)}).encode()
            return whole[: random_.randrange(len(whole) + 1)]
        case 3:
            return b'{"args": {"x": NaN, "x": 1e999}}'
    return json.dumps({text(random_): something(random_) for _ in range(4)}).encode()


def path(random_: random.Random, known: str) -> str:
    if random_.random() < 0.5:
        return known
    end = "".join(random_.choices(string.ascii_letters + "./%-_~?&=;0", k=random_.randrange(1, 40)))
    return known.rpartition("/")[0] + "/" + end
