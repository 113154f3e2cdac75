"""The stops on the page, in a real browser before a played rig: pressed, held back, confirmed."""

from __future__ import annotations

import json
import re
from functools import partial

from playwright.sync_api import APIResponse, Browser, Route, WebSocketRoute, expect
from support.panel.browser import Watched
from support.panel.page import given, press, running, state, turn_to, wait_until
from support.panel.served import ServedPanel


def test_page_cut_off_shows_it_and_recovers(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    panel.line.is_cut = True
    state(page, "Not connected")
    lost = page.locator("#lost")
    expect(lost).to_be_visible()
    expect(lost).to_contain_text("use the hardware emergency stop")
    expect(page.locator(".channel-table tr", has_text="angle")).to_have_attribute("data-stale", "")
    press(page, "Stop")
    expect(page.locator(".stop-result")).to_contain_text("Stop NOT DELIVERED YET")
    assert panel.rig.state == "running"
    panel.line.is_cut = False
    state(page, "Stopping")
    expect(page.locator(".stop-result")).to_contain_text("Stop: confirmed")
    expect(lost).to_be_hidden()


def test_page_that_gets_no_plots_still_stops(panel: ServedPanel, watched: Watched) -> None:
    watched.context.route("**/uPlot.iife.min.js", lambda route: route.abort())
    page = running(panel, watched)
    press(page, "Stop")
    state(page, "Stopping")
    expect(page.locator(".stop-result")).to_contain_text("Stop: confirmed")


def test_an_undelivered_stop_can_be_withdrawn(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    panel.line.is_cut = True
    state(page, "Not connected")
    press(page, "Stop")
    press(page, "Stop sending it")
    expect(page.locator(".stop-result")).to_contain_text("WAS NOT CONFIRMED")
    panel.line.is_cut = False
    state(page, "Running")


def test_a_stop_replaces_no_waiting_abort(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    panel.line.is_cut = True
    state(page, "Not connected")
    press(page, "Abort")
    expect(page.locator(".stop-result")).to_contain_text("Abort NOT DELIVERED YET")
    press(page, "Stop")
    expect(page.locator(".stop-result")).to_contain_text("Abort NOT DELIVERED YET")
    panel.line.is_cut = False
    wait_until(lambda: panel.rig.last is not None)
    assert panel.rig.last is not None and panel.rig.last.ending == "aborted"


def test_a_panel_that_dies_is_noticed(browser: Browser) -> None:
    watched = Watched(browser)
    with ServedPanel() as panel:
        page = watched.enter(panel.links["operator"])
        state(page, "Idle")
    state(page, "Not connected")
    expect(page.locator("#lost")).to_contain_text("The panel does not answer")
    watched.context.close()


def test_esc_held_steps_up_and_tapped_does_nothing(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    page.keyboard.press("Escape")
    page.wait_for_timeout(600)
    assert not given(panel, "stop")
    for verb in ("stop", "abort", "estop"):
        panel.rig.state = "stopping" if verb != "stop" else "running"
        page.keyboard.down("Escape")
        wait_until(lambda verb=verb: bool(given(panel, verb)))  # type: ignore[misc]
        page.keyboard.up("Escape")


def test_abort_and_estop_take_one_press(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    press(page, "Abort")
    wait_until(lambda: bool(given(panel, "abort")))
    panel.rig.state = "running"
    press(page, "E-stop")
    wait_until(lambda: bool(given(panel, "estop")))
    assert not given(panel, "stop")


def test_one_press_stops_with_dialog_open(panel: ServedPanel, watched: Watched) -> None:
    sent = on_stop_line(watched)
    page = running(panel, watched)
    told = page.locator(".stop-result")
    press(page, "Ada")
    expect(page.get_by_role("dialog")).to_be_visible()
    panel.line.held = "stop"
    press(page, "Stop")
    expect(told).to_contain_text("Stop is on its way")
    expect(told).to_contain_text(re.compile(r"Not confirmed for [1-9]"))
    panel.line.held = ""
    expect(told).to_contain_text("Stop: confirmed")
    state(page, "Stopping")
    page.keyboard.press("Escape")
    expect(page.get_by_role("dialog")).to_have_count(0)
    press(page, "Stop")
    expect(told).to_contain_text("Stop: was requested already")
    # Both clicks in one task of the page: a second one that comes late is a second request.
    abort = page.get_by_role("button", name="Abort", exact=True)
    abort.evaluate("one => { one.click(); one.click(); }")
    expect(told).to_contain_text("Abort: confirmed")
    assert sum('"abort"' in str(message) for message in sent) == 1
    state(page, "Idle")
    press(page, "Stop")
    expect(told).to_contain_text("Stop: nothing is running")
    assert watched.complaints == []


def test_a_stop_waits_for_no_slow_request(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    panel.line.held = "dry_run"
    turn_to(page, "Procedures")
    # As many as a browser has connections for, and some more that wait for one.
    page.evaluate("""() => {
      const headers = {"content-type": "application/json", "x-rigd": "1"};
      const body = JSON.stringify({args: {set: {}}});
      for (let count = 0; count < 10; count++)
        fetch("/api/command/dry_run", {method: "POST", headers, body});
    }""")
    wait_until(lambda: panel.line.verbs.count("dry_run") == 6)
    press(page, "Stop")
    state(page, "Stopping")
    expect(page.locator(".stop-result")).to_contain_text("Stop: confirmed")
    assert len(given(panel, "stop")) == 1
    assert panel.line.verbs.count("dry_run") == 6, "all connections are held still"


def test_enter_held_on_focused_stop_stops_once(panel: ServedPanel, watched: Watched) -> None:
    sent = on_stop_line(watched)
    page = running(panel, watched)
    page.get_by_role("button", name="Stop", exact=True).focus()
    held_ms = 1500  # longer than the page takes a second press for the same
    released = page.evaluate("performance.now()") + held_ms
    while page.evaluate("performance.now()") < released:
        page.keyboard.down("Enter")  # from the second on the browser marks it as a repeat
    state(page, "Stopping")
    expect(page.locator(".stop-result")).to_contain_text("Stop: confirmed")
    page.keyboard.up("Enter")
    assert len(sent) == 1


def test_stop_answered_the_second_way_is_confirmed(panel: ServedPanel, watched: Watched) -> None:
    sent = on_stop_line(watched, answers=False)
    page = running(panel, watched)
    press(page, "Stop")
    expect(page.locator(".stop-result")).to_contain_text("Stop: confirmed")
    assert (len(sent), len(given(panel, "stop"))) == (1, 2)


def test_stop_is_confirmed_by_either_answer(panel: ServedPanel, watched: Watched) -> None:
    """The request of the second way is carried out first; its answer comes last."""
    lines: list[WebSocketRoute] = []
    numbers: list[int] = []
    second: list[tuple[Route, APIResponse]] = []

    def held(line: WebSocketRoute) -> None:
        lines.append(line)
        line.on_message(lambda message: numbers.append(json.loads(message)["number"]))

    watched.context.route_web_socket(re.compile("/api/stop/line"), held)
    watched.context.route(
        re.compile("/api/stop/stop$"), lambda route: second.append((route, route.fetch()))
    )
    page = running(panel, watched)
    press(page, "Stop")
    state(page, "Stopping")
    expect(page.locator(".stop-result")).to_contain_text("Stop is on its way")
    lines[-1].send(json.dumps({"number": numbers[0], "answer": {"acted": False}}))
    expect(page.locator(".stop-result")).to_contain_text("Stop: confirmed")
    ((route, answer),) = second
    assert answer.json()["acted"] is True
    route.fulfill(response=answer)


def on_stop_line(watched: Watched, *, answers: bool = True) -> list[str | bytes]:
    """Return what pages opened from now on send by the WebSocket for stops, as it grows.

    Without ``answers`` no answer comes back by it.
    """
    sent: list[str | bytes] = []

    def pass_on(way: WebSocketRoute, message: str | bytes) -> None:
        sent.append(message)
        way.send(message)

    def between(page: WebSocketRoute) -> None:
        server = page.connect_to_server()
        page.on_message(partial(pass_on, server))
        if not answers:
            server.on_message(lambda _: None)

    watched.context.route_web_socket(re.compile("/api/stop/line"), between)
    return sent
