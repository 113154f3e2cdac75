"""A thousand random requests on every door: none is answered by a fault, none changes anything."""

from __future__ import annotations

import json
import random
import string
from collections.abc import Iterator
from typing import Any

import pytest
from support.panel import ServedPanel, Visitor

from rigd.panel import guard
from rigd.panel.rates import Bucket

COUNT = 1000
GETS = ("/", "/static/js/main.js", "/api/session", "/api/run/x/report", "/api/run/x/recording")
POSTS = (
    "/api/login", "/api/logout", "/api/invite", "/api/ask/describe", "/api/ask/run",
    "/api/command/start", "/api/command/answer", "/api/control/give", "/api/stop/stop",
)  # fmt: skip
DOORS = [*(("GET", path) for path in GETS), *(("POST", path) for path in POSTS)]


@pytest.fixture(scope="module")
def panel() -> Iterator[ServedPanel]:
    """A panel that lets a flood through, so that everything behind the rates is reached."""
    patch = pytest.MonkeyPatch()
    patch.setattr(guard, "PER_S", 1e6)
    patch.setattr(guard, "BURST", 1e6)
    patch.setattr(Bucket, "take", lambda self: True)
    with ServedPanel() as served:
        yield served
    patch.undo()


@pytest.fixture(scope="module")
def host(panel: ServedPanel) -> Visitor:
    return panel.visitor()


@pytest.fixture
def visitor(panel: ServedPanel, host: Visitor) -> Iterator[Visitor]:
    """Somebody who has control, so that a request is refused for what it says alone."""
    visitor = Visitor(panel)
    visitor.login(host.post("/api/invite", role="operator")[1]["code"], "Mallory")
    with visitor.page():
        assert visitor.post("/api/control/take", args={})[0] == 200
        yield visitor
        visitor.post("/api/control/release", args={})


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


@pytest.mark.parametrize(("method", "known"), DOORS)
def test_random_requests(panel: ServedPanel, visitor: Visitor, method: str, known: str) -> None:
    random_ = random.Random(f"{method} {known}")
    before = panel.rig.changes
    seen: set[int] = set()
    for _ in range(COUNT):
        wild: dict[str, str | None] = {}
        if random_.random() < 0.2:
            name = random_.choice(["origin", "x-rigd", "content-type", "content-length", "cookie"])
            wild[name] = random_.choice([None, "", "x", "\xff", "1" * 40])
        sent = body(random_) if method == "POST" else b""
        where = path(random_, known)
        try:
            status, _, answer = visitor.send(method, where, sent, **wild)
        except OSError:
            continue  # what is no HTTP at all may be cut off
        seen.add(status)
        assert status < 500, (where, sent, wild, answer)
    assert seen & {400, 401, 403, 404, 405}, "random requests are refused"
    assert panel.rig.changes == before
    assert visitor.get("/api/session")[0] == 200, "it still serves"
