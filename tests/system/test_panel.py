"""The panel that `rigd serve` starts, in a real browser, on a simulated rig."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from support.browser import Watched, chromium
from support.killing import own_state
from support.wire import ROOT, free_ports

NAME = "panel-test"
#: A crowded machine does everything within this: compiling kernels, identifying.
PATIENCE_S = 120.0
expect.set_options(timeout=PATIENCE_S * 1000)

#: Two trials, a question first; with 1 A the rig's interlock trips.
ASKING = """\
procedure: asking
title: Asks, then turns the wheel
doc: For tests.
parameters:
  current: {doc: Amplitude, unit: A, default: 0.3 A, min: 0 A, max: 1.5 A}
repeats: 2
prepare:
  - prompt: weigh
    text: What does the scale show?
    unit: kg
    min: 1 kg
    max: 6 kg
    answer: 3.9 kg
trial:
  steps:
    - step: shake
      set: {wheel_servo.current: {sine: {amplitude: "${current}", frequency: 2 Hz}}}
      for: 6 s
finish:
  - step: hold
    set: {wheel_servo.current: 0 A}
    for: 0.2 s
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rig whose interlock trips at 0.8 A, a procedure that asks, and a recording."""
    made = tmp_path_factory.mktemp("panel")
    text = (ROOT / "configs" / "sim_lugre.yaml").read_text()
    for old, new in {
        "rig: lugre-1": f"rig: {NAME}",
        "$schema=../": f"$schema={ROOT}/",
        "parameters: plants/": f"parameters: {ROOT}/configs/plants/",
        "low: -1.8 A\n    high: 1.8 A": "low: -0.8 A\n    high: 0.8 A\n    latch: true",
        "stale_after: 20 ms": "stale_after: 150 ms",
    }.items():
        assert old in text, old
        text = text.replace(old, new)
    endpoint = f"tcp/127.0.0.1:{free_ports(1)[0]}"
    (made / "rig.yaml").write_text(f"{text}\nremote: {{listen: [{endpoint}]}}\n")
    (made / "procedures").mkdir()
    (made / "procedures" / "asking.yaml").write_text(ASKING)
    (made / "runs").mkdir()
    subprocess.run(
        [sys.executable, "-m", "rigd", "run", "constant_current", "--rig", "lugre-1",
         "--output", str(made / "runs" / "before.mcap")],
        cwd=ROOT, check=True, capture_output=True,
    )  # fmt: skip
    return made


@pytest.fixture
def daemon(folder: Path, tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    state = own_state(tmp_path)
    process = subprocess.Popen(
        [sys.executable, "-m", "rigd", "serve", "--rig", str(folder / "rig.yaml"),
         "--runs", str(folder / "runs"), "--procedures", str(folder / "procedures")],
        cwd=ROOT,
        env={**os.environ, "RIGD_STATE": str(state)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )  # fmt: skip
    yield process
    if process.poll() is None:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(60)
        finally:
            process.kill()
    assert process.stdout is not None
    process.stdout.close()
    shutil.rmtree(state)


def link_of(daemon: subprocess.Popen[str]) -> str:
    """Return the link that is printed once the panel serves."""
    assert daemon.stdout is not None
    for line in daemon.stdout:
        found = re.search(r"panel of .*: (http://\S+#\S+)", line)
        if found:
            return found[1]
    raise AssertionError("no link was printed")


def press(page: Page, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).click()


def state(page: Page, text: str) -> None:
    expect(page.locator(".state-word")).to_have_text(text)


def start(page: Page, current: str) -> None:
    """Start `asking` from the page, and answer its question."""
    page.get_by_role("link", name="Procedures", exact=True).click()
    page.get_by_role("button", name=re.compile("Asks, then turns")).click()
    page.get_by_label("current").fill(current)
    press(page, "Start…")
    press(page, "Start now")
    state(page, "Waiting for you")
    page.get_by_label("Answer", exact=True).fill("3.9")
    press(page, "Answer")
    state(page, "Running")


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def drawn(page: Page) -> int:
    return int(page.locator(".traces").get_attribute("data-drawn") or 0)


def test_everything_an_operator_does(daemon: subprocess.Popen[str], folder: Path) -> None:
    with chromium() as browser:
        watched = Watched(browser)
        page = watched.enter(link_of(daemon))
        state(page, "Idle")
        press(page, "Take control")
        expect(page.locator("#control")).to_contain_text("You have control")

        start(page, "0.3")
        before = drawn(page)
        wait_until(lambda: drawn(page) > before + 20)
        current = page.locator(".channel-table tr", has_text="current").last.locator(".value")
        seen: set[str] = set()
        for _ in range(5):
            seen.add(current.inner_text())
            wait_until(lambda: current.inner_text() not in seen)
        press(page, "Pause")
        state(page, "Paused")
        press(page, "Resume")
        state(page, "Running")
        press(page, "Stop")
        state(page, "Idle")
        expect(page.locator(".run")).to_contain_text("stopped")

        start(page, "1")
        state(page, "Tripped")
        expect(page.locator(".trip")).to_contain_text("over current")
        press(page, "Acknowledge")
        expect(page.locator(".trip")).to_have_count(0)
        state(page, "Idle")

        page.get_by_role("link", name="Runs", exact=True).click()
        page.locator(".run-list tr", has_text="constant current").click()
        press(page, "Make the report")
        report = page.frame_locator(".report iframe")
        expect(report.locator("body")).to_contain_text("LuGre")
        with page.expect_download() as download:
            page.get_by_role("link", name=re.compile("Recording")).click()
        path = download.value.path()
        assert path.read_bytes() == (folder / "runs" / "before.mcap").read_bytes()

        page.get_by_role("link", name="Events", exact=True).click()
        expect(page.locator(".event-table")).to_contain_text("interlock")
        assert watched.complaints == []
        assert all(url.startswith(page.url.partition("#")[0]) for url in watched.asked)


def test_who_closes_the_page_is_a_client_that_vanished(daemon: subprocess.Popen[str]) -> None:
    """The run is stopped, as the procedure says of a client that is lost."""
    with chromium() as browser:
        first = Watched(browser)
        page = first.enter(link_of(daemon))
        press(page, "Ada")
        press(page, "Link to watch")
        link = page.locator("output.link code").inner_text()
        press(page, "Close")
        press(page, "Take control")
        second = Watched(browser)
        observer = second.enter(link, "Olga")
        start(page, "0.3")
        first.context.close()
        state(observer, "Idle")
        expect(observer.locator(".run")).to_contain_text("stopped")


def test_a_daemon_that_is_killed_is_shown_as_lost(daemon: subprocess.Popen[str]) -> None:
    with chromium() as browser:
        watched = Watched(browser)
        page = watched.enter(link_of(daemon))
        state(page, "Idle")
        daemon.kill()
        state(page, "Not connected")
        expect(page.locator("#lost")).to_contain_text("use the hardware emergency stop")
