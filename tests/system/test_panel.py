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
from support.commands.asking import ASKING
from support.commands.command import rigd
from support.faults.killing import own_state
from support.panel.browser import Watched, chromium
from support.panel.page import press, state
from support.wire import ROOT, free_ports

from rigd.remote import Client

NAME = "panel-test"
ENDPOINT = f"tcp/127.0.0.1:{free_ports(1)[0]}"
#: A crowded machine does everything within this: compiling kernels, identifying.
PATIENCE_S = 120.0
expect.set_options(timeout=PATIENCE_S * 1000)


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
        "cycle: 1 kHz": "cycle: 250 Hz",
    }.items():
        assert old in text, old
        text = text.replace(old, new)
    (made / "rig.yaml").write_text(f"{text}\nremote: {{listen: [{ENDPOINT}]}}\n")
    (made / "procedures").mkdir()
    (made / "procedures" / "asking.yaml").write_text(
        ASKING.replace("default: 0.5 s", "default: 6 s")  # with 1 A the interlock trips
    )
    (made / "runs").mkdir()
    text = (ROOT / "procedures" / "constant_current.yaml").read_text()
    few = text.replace("step: 0.15 A", "step: 0.45 A")
    assert few != text
    (made / "few.yaml").write_text(few)
    words = ("run", made / "few.yaml", "--rig", "lugre-1", "--output", "before.mcap")
    done = rigd(*words, "--set", "brake_at=0.5 m", cwd=made / "runs")
    assert done.code == 0, done.err
    return made


class Serving:
    """`rigd serve` with its panel, which can be killed and started again."""

    def __init__(self, folder: Path, state: Path) -> None:
        self._state = state
        self._command = [
            sys.executable, "-m", "rigd", "serve", "--rig", str(folder / "rig.yaml"),
            "--runs", str(folder / "runs"), "--procedures", str(folder / "procedures"),
            "--panel-port", str(free_ports(1)[0]),
        ]  # fmt: skip
        self._processes: list[subprocess.Popen[str]] = []
        self.start()

    def start(self) -> None:
        """Start it, again if it was killed."""
        process = subprocess.Popen(
            self._command,
            cwd=ROOT,
            env={**os.environ, "RIGD_STATE": str(self._state)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self._processes.append(process)

    def link(self) -> str:
        """Return the link that is printed once a panel serves."""
        for line in self._processes[-1].stdout or ():
            if found := re.search(r"panel of .*: (http://\S+#\S+)", line):
                return found[1]
        raise AssertionError("no link was printed")

    def kill(self) -> None:
        """Kill the daemon; its panel ends with it."""
        self._processes[-1].kill()

    def kill_panel(self) -> None:
        """Kill the panel, as a lack of memory would."""
        pid = self._processes[-1].pid
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        # The kernel lists the older first; the younger is the spare that stands by.
        panel, *_ = (
            int(child)
            for child in children
            if b"\0panel\0" in Path(f"/proc/{child}/cmdline").read_bytes()
        )
        os.kill(panel, signal.SIGKILL)

    def end(self) -> None:
        """End what is left."""
        for process in self._processes:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                try:
                    process.wait(60)
                finally:
                    process.kill()
            process.communicate()


@pytest.fixture(scope="module")
def serving(folder: Path) -> Iterator[Serving]:
    state = own_state(folder)
    serving = Serving(folder, state)
    yield serving
    serving.end()
    shutil.rmtree(state)


@pytest.fixture(scope="module")
def ada(serving: Serving) -> Iterator[Watched]:
    """The page of Ada, whose link is the one that is printed."""
    with chromium() as browser:
        watched = Watched(browser)
        watched.enter(serving.link())
        yield watched


@pytest.fixture
def page(ada: Watched) -> Iterator[Page]:
    """The same before a rig that rests, without a holder; it is left so, unless it is closed."""
    state(ada.page, "Idle")
    yield ada.page
    if not ada.page.is_closed():
        state(ada.page, "Idle")
        press(ada.page, "Release")


def take_control(page: Page) -> None:
    press(page, "Take control")
    expect(page.locator("#control")).to_contain_text("You have control")


def start(page: Page, current: str, then: str = "Running") -> None:
    """Start `asking` from the page, and answer its question; the page then shows ``then``."""
    page.get_by_role("link", name="Procedures", exact=True).click()
    page.get_by_role("button", name=re.compile("Asks, then turns")).click()
    page.get_by_label("current", exact=True).fill(current)
    press(page, "Start…")
    press(page, "Start now")
    state(page, "Waiting for you")
    page.get_by_label("Answer", exact=True).fill("3.9")
    press(page, "Answer")
    state(page, then)


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def drawn(page: Page) -> int:
    return int(page.locator(".traces").get_attribute("data-drawn") or 0)


def test_operator_can_complete_a_session_in_panel(ada: Watched, page: Page, folder: Path) -> None:
    with Client(NAME, endpoint=ENDPOINT, identity="bob") as bob, bob.control():
        expect(page.locator("#control")).to_contain_text("bob has control")
        press(page, "Request it")
        wait_until(lambda: [item.identity for item in bob.status().lease.asked_by] == ["panel"])
    take_control(page)

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

    start(page, "1", then="Tripped")  # at once: it runs for less than the page is looked at
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
    assert ada.complaints == []
    assert all(url.startswith(page.url.partition("#")[0]) for url in ada.asked)


def test_killed_process_is_shown_lost_and_returns(serving: Serving, page: Page) -> None:
    serving.kill_panel()
    state(page, "Not connected")
    expect(page.locator("#lost")).to_contain_text("use the hardware emergency stop")

    state(page, "Idle")  # of the next panel, without a new link
    take_control(page)
    start(page, "0.3")
    serving.kill()
    state(page, "Not connected")

    serving.start()
    expect(page.locator("#attention")).to_contain_text("A run was interrupted after 0 of 2")
    take_control(page)
    press(page, "Continue it…")
    press(page, "Continue now")
    state(page, "Waiting for you")
    press(page, "Abort")
    expect(page.locator(".stop-result")).to_contain_text("Abort: confirmed")
    state(page, "Idle")


def test_a_closed_page_counts_as_a_vanished_client(ada: Watched, page: Page) -> None:
    """The run is stopped, as the procedure specifies for a lost client."""
    press(page, "Ada")
    press(page, "Link to watch")
    link = page.locator("output.link code").inner_text()
    press(page, "Close")
    take_control(page)
    second = Watched(ada.browser)
    observer = second.enter(link, "Olga")
    start(page, "0.3")
    ada.context.close()
    state(observer, "Idle")
    expect(observer.locator(".run")).to_contain_text("stopped")
