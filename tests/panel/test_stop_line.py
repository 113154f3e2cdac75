"""The connection that a page has for stops alone: as guarded as every other, and never waiting."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from support.panel.served import ServedPanel, Visitor
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection

from rigd.panel.feed import MOST_PER_SESSION

LINE = "/api/stop/line"


@pytest.fixture
def panel() -> Iterator[ServedPanel]:
    with ServedPanel() as served:
        yield served


def say(line: ClientConnection, number: int, verb: str) -> None:
    line.send(json.dumps({"number": number, "verb": verb}))


def answer(line: ClientConnection) -> dict[str, Any]:
    told: dict[str, Any] = json.loads(line.recv(30))
    return told


def test_an_observer_stops_by_the_line(panel: ServedPanel) -> None:
    panel.rig.state = "running"
    with panel.visitor("observer", "Olga").page(path=LINE) as line:
        say(line, 7, "stop")
        assert answer(line) == {"number": 7, "answer": {"acted": True}}
    assert panel.rig.users("stop") == ["Olga"]


def test_estop_does_not_wait_for_stop(panel: ServedPanel) -> None:
    panel.rig.state = "running"
    panel.line.held = "stop"
    with panel.visitor().page(path=LINE) as line:
        say(line, 1, "stop")
        say(line, 2, "start")
        assert answer(line)["error"]["code"] == "unknown_verb"
        say(line, 3, "estop")
        assert answer(line) == {"number": 3, "answer": {"acted": True}}


def test_stop_line_needs_a_session(panel: ServedPanel) -> None:
    with pytest.raises(InvalidStatus):
        Visitor(panel).page(path=LINE)
    with pytest.raises(InvalidStatus):
        panel.visitor().page("http://evil.example", LINE)
    assert "stop" not in panel.line.verbs


def test_message_that_is_no_stop_closes_the_line(panel: ServedPanel) -> None:
    visitor = panel.visitor()
    for text in ("{}", "stop", '{"number": 1}', '{"number": "1", "verb": "stop"}', "9" * 500):
        with visitor.page(path=LINE) as line, pytest.raises(ConnectionClosed):
            line.send(text)
            line.recv(30)
    assert "stop" not in panel.line.verbs


def test_logout_closes_the_stop_line(panel: ServedPanel) -> None:
    visitor = panel.visitor()
    with visitor.page(path=LINE) as line:
        assert visitor.post("/api/logout")[0] == 200
        with pytest.raises(ConnectionClosed):
            line.recv(30)
    with pytest.raises(InvalidStatus):
        visitor.page(path=LINE)


def test_lines_are_bounded_and_given_back(panel: ServedPanel) -> None:
    visitor = panel.visitor()
    for _ in range(2):
        with ExitStack() as stack:
            lines = [stack.enter_context(visitor.page(path=LINE)) for _ in range(MOST_PER_SESSION)]
            with pytest.raises(InvalidStatus):
                visitor.page(path=LINE)
            say(lines[-1], 1, "stop")
            assert answer(lines[-1])["number"] == 1
