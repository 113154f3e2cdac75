"""The stops on the page, in a real browser before a played rig: pressed, held back, confirmed."""

from __future__ import annotations

from playwright.sync_api import Browser, expect
from support.browser import Watched
from support.page import given, press, running, state, turn_to, wait_until
from support.panel import ServedPanel


def test_a_page_cut_off_says_so_and_returns(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    panel.rig.is_silent = True
    state(page, "Not connected")
    lost = page.locator("#lost")
    expect(lost).to_be_visible()
    expect(lost).to_contain_text("use the hardware emergency stop")
    expect(page.locator(".channel-table tr", has_text="angle")).to_have_attribute("data-stale", "")
    press(page, "Stop")
    expect(page.locator(".stop-told")).to_contain_text("Stop NOT DELIVERED YET")
    assert panel.rig.state == "running"
    panel.rig.is_silent = False
    state(page, "Stopping")
    expect(page.locator(".stop-told")).to_contain_text("Stop: confirmed")
    expect(lost).to_be_hidden()


def test_an_undelivered_stop_can_be_withdrawn(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    panel.rig.is_silent = True
    state(page, "Not connected")
    press(page, "Stop")
    press(page, "Do not send it any more")
    expect(page.locator(".stop-told")).to_contain_text("WAS NOT CONFIRMED")
    panel.rig.is_silent = False
    state(page, "Running")


def test_a_stop_replaces_no_waiting_abort(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    panel.rig.is_silent = True
    state(page, "Not connected")
    press(page, "Abort")
    expect(page.locator(".stop-told")).to_contain_text("Abort NOT DELIVERED YET")
    press(page, "Stop")
    expect(page.locator(".stop-told")).to_contain_text("Abort NOT DELIVERED YET")
    panel.rig.is_silent = False
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
        wait_until(lambda verb=verb: len(given(panel, verb)) == 1)  # type: ignore[misc]
        page.keyboard.up("Escape")


def test_abort_and_estop_take_one_press(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    press(page, "Abort")
    wait_until(lambda: len(given(panel, "abort")) == 1)
    panel.rig.state = "running"
    press(page, "E-stop")
    wait_until(lambda: len(given(panel, "estop")) == 1)
    assert not given(panel, "stop")


def test_one_press_stops_whatever_is_open(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    told = page.locator(".stop-told")
    press(page, "Ada")
    expect(page.get_by_role("dialog")).to_be_visible()
    panel.rig.delay_s = 2.0
    press(page, "Stop")
    expect(told).to_contain_text("Stop is on its way")
    expect(told).to_contain_text("Not confirmed for 1")
    expect(told).to_contain_text("Stop: confirmed")
    state(page, "Stopping")
    page.keyboard.press("Escape")
    expect(page.get_by_role("dialog")).to_have_count(0)
    panel.rig.delay_s = 0.0
    press(page, "Stop")
    expect(told).to_contain_text("Stop: was asked for already")
    press(page, "Abort")
    expect(told).to_contain_text("Abort: confirmed")
    press(page, "Abort")
    wait_until(lambda: len(given(panel, "abort")) == 1)
    state(page, "Idle")
    press(page, "Stop")
    expect(told).to_contain_text("Stop: nothing is running")
    assert watched.complaints == []


def test_a_stop_waits_for_no_slow_request(panel: ServedPanel, watched: Watched) -> None:
    page = running(panel, watched)
    panel.rig.dry_run_s = 600.0
    turn_to(page, "Procedures")
    # As many as a browser has connections for, and some more that wait for one.
    page.evaluate("""() => {
      const headers = {"content-type": "application/json", "x-rigd": "1"};
      const body = JSON.stringify({args: {set: {}}});
      for (let count = 0; count < 10; count++)
        fetch("/api/command/dry_run", {method: "POST", headers, body});
    }""")
    wait_until(lambda: len(given(panel, "dry_run")) == 6)
    press(page, "Stop")
    state(page, "Stopping")
    expect(page.locator(".stop-told")).to_contain_text("Stop: confirmed")
    assert len(given(panel, "stop")) == 1
    assert len(given(panel, "dry_run")) == 6, "all connections are held still"
