"""What a page hears: everything when it joins, changes at once, and silence as what it is."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from types import SimpleNamespace
from typing import Any

import pytest
from starlette.websockets import WebSocket
from support.panel.played_campaign import STREAMS
from support.panel.played_rig import EVENTS_OF_ANSWER, PlayedRig
from support.panel.served import ServedPanel
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from rigd.panel.feed import MOST_PER_SESSION, PageSocket
from rigd.panel.messages import PageEvent
from rigd.panel.outbox import Outbox
from rigd.remote.protocol.frame import Frame, decode_frame
from rigd.remote.protocol.status import Status


@pytest.fixture
def panel() -> Iterator[ServedPanel]:
    with ServedPanel(PlayedRig(prompts=())) as served:
        yield served


def hear(page: ClientConnection, what: str, **wanted: Any) -> dict[str, Any]:
    """Return the next message of that kind that has what is wanted."""
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        message = page.recv(20)
        if isinstance(message, bytes):
            page.send("drawn")
            continue
        told = json.loads(message)
        if told["kind"] != what:
            continue
        inner = told[what]
        if all(inner.get(key) == value for key, value in wanted.items()):
            return dict(inner)
    raise TimeoutError(f"no {what} with {wanted}")


def test_late_page_gets_description_and_past_events(panel: ServedPanel) -> None:
    visitor = panel.visitor()
    with visitor.page() as page:  # the panel has described its rig before events come
        hear(page, "describe")
        panel.rig.emit("trial_end", number=3)
        hear(page, "event", kind="trial_end")
    with visitor.page() as page:
        assert hear(page, "panel", alive=True)
        assert hear(page, "describe")["rig"] == "lugre-1"
        status = hear(page, "status")
        assert hear(page, "event", kind="trial_end")["data"] == {"number": 3}
    Status.model_validate_json(json.dumps(status))  # as the protocol has it, and nothing else


def test_new_panel_fetches_the_newest_events() -> None:
    rig = PlayedRig()
    for _ in range(EVENTS_OF_ANSWER + 1):
        rig.emit("step")
    with ServedPanel(rig) as panel, panel.visitor().page() as page:
        hear(page, "event", seq=EVENTS_OF_ANSWER)


def test_description_is_asked_again_with_other_streams(panel: ServedPanel) -> None:
    with panel.visitor().page() as page:
        hear(page, "describe")
        panel.rig.emit("streams", added=["own"])
        assert hear(page, "describe")["rig"] == "lugre-1"


def test_connections_of_the_daemon_change_no_description(panel: ServedPanel) -> None:
    visitor = panel.visitor()
    with visitor.page() as page:
        hear(page, "describe")
        panel.rig.emit("trial_end", number=3)
        hear(page, "event", kind="trial_end")
        panel.rig.descriptors += 1
        while hear(page, "status")["daemon"]["descriptors"] != panel.rig.descriptors:
            pass
        for _ in range(3):  # more than the time in which a missing description is asked for
            hear(page, "panel")
        assert len(panel.rig.given("describe")) == 1
    with visitor.page() as page:
        assert hear(page, "event", kind="trial_end")["data"] == {"number": 3}


def test_values_are_asked_for_while_nothing_plays(panel: ServedPanel) -> None:
    with panel.visitor().page() as page:
        values = hear(page, "latest")["values"]
        assert values["longitudinal_belt.engaged"] == {"value": 1.0, "age_s": 0.2}


def test_frames_come_while_it_plays(panel: ServedPanel) -> None:
    visitor = panel.visitor()
    with visitor.page() as page:
        panel.rig.state = "running"
        batches = 0
        while batches < 20:
            message = page.recv(20)
            if isinstance(message, bytes):
                batches += 1
                assert decode_frame_at(message).stream < len(STREAMS)
                page.send("drawn")


def decode_frame_at(batch: bytes) -> Frame:
    """Return the first frame of a batch; its length stands in its head."""
    channels = int.from_bytes(batch[6:8], "little")
    points = int.from_bytes(batch[8:12], "little")
    return decode_frame(batch[: 24 + 8 * points * (1 + channels)])


def test_page_that_draws_nothing_gets_two_batches_only(
    panel: ServedPanel,
) -> None:
    with panel.visitor().page() as page:
        panel.rig.state = "running"
        batches, statuses = 0, 0
        while statuses < 12:
            message = page.recv(20)
            batches += isinstance(message, bytes)
            statuses += isinstance(message, str) and '"kind":"status"' in message
        assert batches == 2


def test_silent_daemon_is_shown_lost_then_found(panel: ServedPanel) -> None:
    with panel.visitor().page() as page:
        hear(page, "panel", alive=True)
        panel.line.is_cut = True
        assert hear(page, "panel", alive=False)["silent_s"] >= 2.0
        panel.line.is_cut = False
        hear(page, "panel", alive=True)


def test_new_page_gets_units_of_present_trial(panel: ServedPanel) -> None:
    panel.rig.state = "running"
    with panel.visitor().page() as page:
        trial = hear(page, "status", state="running")["trial"]
        assert (trial["units"], trial["scales"]) == (
            {"current": "A"},
            {"current": {"factor": 1.0, "offset": 0.0}},
        )


def test_change_is_sent_at_once(panel: ServedPanel) -> None:
    visitor = panel.visitor()
    with visitor.page() as page:
        hear(page, "status")
        visitor.post("/api/command/lease_take", args={})
        status = hear(page, "status")
        while status["lease"]["holder"] is None:
            status = hear(page, "status")
        assert status["lease"]["holder"] == {"identity": "panel", "user": "Ada"}


def test_pages_of_one_session_are_bounded(panel: ServedPanel) -> None:
    visitor = panel.visitor()
    with ExitStack() as stack:
        for _ in range(MOST_PER_SESSION):
            hear(stack.enter_context(visitor.page()), "panel")
        with pytest.raises(ConnectionClosed, match="too many pages"):
            stack.enter_context(visitor.page()).recv(20)


def test_malformed_frame_does_not_disturb_pages(
    panel: ServedPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    from support.panel import played_rig

    monkeypatch.setattr(played_rig, "encode_frame", lambda frame: b"RGF1 nonsense")
    with panel.visitor().page() as page:
        panel.rig.state = "running"
        for _ in range(3):
            hear(page, "status")


def test_past_is_sent_as_finely_as_it_came(panel: ServedPanel) -> None:
    visitor = panel.visitor()
    with visitor.page() as page:
        hear(page, "describe")
        page.send("points 10")
        panel.rig.state = "running"
        batches: list[bytes] = []
        while len(batches) < 8:
            message = page.recv(20)
            if isinstance(message, bytes):
                batches.append(message)
                page.send("drawn")
    coarse = [decode_frame_at(batch) for batch in batches[3:]]
    times_s = [frame.t0_ns * 1e-9 + frame.time_s[-1] for frame in coarse]
    assert sum(frame.time_s.size for frame in coarse) < 20 * (times_s[-1] - times_s[0]) + 10
    query = f"/api/past?from_s={times_s[0]}&to_s={times_s[-1]}&points=4096"
    status, _, body = visitor.get(query)
    assert status == 200
    fine = decode_frame_at(body)
    assert fine.time_s.size > 500 * (times_s[-1] - times_s[0]), "a row each ms"
    assert times_s[0] - 1e-6 <= fine.t0_ns * 1e-9 + fine.time_s[0]
    assert fine.t0_ns * 1e-9 + fine.time_s[-1] <= times_s[-1] + 1e-6
    assert visitor.get("/api/past?from_s=x")[0] == 400
    visitor.cookie = ""
    assert visitor.get(query)[0] == 401


class LeavingPage:
    """A page that says goodbye as it is written to, in the words of uvicorn 0.38 and later."""

    def __init__(self, said: str) -> None:
        self.said = [{"type": "websocket.receive", "text": said}] if said else []
        self.said.insert(0, {"type": "websocket.connect"})

    async def receive(self) -> Any:
        if not self.said:
            await asyncio.Event().wait()
        return self.said.pop(0)

    async def send(self, message: Any) -> None:
        if message["type"] != "websocket.accept":
            raise RuntimeError(f"Unexpected ASGI message {message['type']!r}, after sending")


@pytest.mark.parametrize("said", ["", "nonsense"])
def test_page_that_leaves_while_written_to_is_harmless(said: str) -> None:
    @contextmanager
    def join() -> Iterator[Outbox]:
        outbox = Outbox()
        if not said:
            outbox.event(PageEvent(v=1, seq=1, t_ns=0, kind="note"))
        yield outbox

    async def serve() -> int:
        page = LeavingPage(said)
        closed: list[object] = []
        session = SimpleNamespace(role="operator", pages=0, over=asyncio.Event())
        sessions = SimpleNamespace(open_page=lambda _: None, close_page=closed.append)
        api: Any = SimpleNamespace(find=lambda _: session, sessions=sessions)
        hub: Any = SimpleNamespace(join=join)
        socket = WebSocket({"type": "websocket", "headers": []}, page.receive, page.send)
        await asyncio.wait_for(PageSocket(hub, api).serve(socket), 60)
        return len(closed)

    assert asyncio.run(serve()) == 1
