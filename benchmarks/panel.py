"""How fresh the panel's page is and what it costs, before a run on a simulated rig in real time.

`rigd serve` on the simulated LuGre rig, its panel, and three headless Chromium pages. Measured: how
old the newest sample is when it has been drawn (from the sample's own time to the end of the frame
that shows it, so half a frame of 1/30 s is in it), frames drawn per second, and the share of a core
that panel, daemon and browser (which draws by software here) take with one page and with three.

    python benchmarks/panel.py --seconds 10
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from figures import noted
from playwright.sync_api import Browser, Page, sync_playwright

from rigd.remote import Client

ROOT = Path(__file__).resolve().parents[1]
PATIENCE_MS = 120_000
#: Of the rig that is served.
NAME = "panel-bench"

#: Moves for long enough.
SHAKE = """\
procedure: shake
title: Turns the wheel to and fro
doc: For the benchmark of the panel.
trial:
  steps:
    - step: shake
      set: {wheel_servo.current: {sine: {amplitude: 0.3 A, frequency: 2 Hz}}}
      for: 7200 s
finish:
  - step: hold
    set: {wheel_servo.current: 0 A}
    for: 0.2 s
"""

#: Notes, behind each painted frame, how old the newest sample is that it shows.
WATCH = """async (seconds) => {
  const { newestTime } = await import("/static/js/histories.js");
  const ages = [];
  let shown = newestTime();
  const end = performance.now() + 1000 * seconds;
  await new Promise((done) => {
    const frame = () => setTimeout(() => {
      const newest = newestTime();
      if (newest > shown) ages.push(Date.now() / 1000 - newest);
      shown = newest;
      if (performance.now() < end) requestAnimationFrame(frame); else done();
    });
    requestAnimationFrame(frame);
  });
  return ages;
}"""


class Served(NamedTuple):
    """A rig that moves: its daemon, the link that opens its panel, and its address for clients."""

    daemon: subprocess.Popen[str]
    link: str
    endpoint: str


@contextmanager
def served(folder: Path) -> Iterator[Served]:
    """Serve a copy of the shipped rig, and let it move."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    text = (ROOT / "configs" / "sim_lugre.yaml").read_text()
    text = text.replace("parameters: plants/", f"parameters: {ROOT}/configs/plants/")
    text = text.replace("rig: lugre-1", f"rig: {NAME}")
    text = text.replace("stale_after: 20 ms", "stale_after: 500 ms")  # a shared host may be away
    (folder / "rig.yaml").write_text(f"{text}\nremote: {{listen: [{endpoint}]}}\n")
    (folder / "procedures").mkdir()
    (folder / "procedures" / "shake.yaml").write_text(SHAKE)
    daemon = subprocess.Popen(
        [sys.executable, "-m", "rigd", "serve", "--rig", str(folder / "rig.yaml"),
         "--runs", str(folder / "runs"), "--procedures", str(folder / "procedures")],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        for line in daemon.stdout or ():
            found = re.search(r"panel of .*: (http://\S+#\S+)", line)
            if found:
                move(endpoint)
                yield Served(daemon, found[1], endpoint)
                break
        else:
            raise SystemExit("the daemon did not start")
    finally:
        daemon.send_signal(signal.SIGTERM)
        daemon.communicate(timeout=60)


def move(endpoint: str) -> None:
    """Start a run that needs no operator, and return once it moves."""
    with Client(NAME, endpoint=endpoint) as client, client.control():
        client.start("shake", on_client_loss="continue")
        next(item for item in client.watch() if item.state == "running")


def cpu_s(pid: int) -> float:
    """Return the CPU time of a process in s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def browser_pids() -> list[int]:
    """Return the processes of the browser that this one has started."""
    return [pid for pid in descendants(os.getpid()) if b"chrom" in cmdline(pid)]


def descendants(pid: int) -> Iterator[int]:
    """Yield the processes that ``pid`` has started, and those that they have."""
    for children in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(FileNotFoundError, ProcessLookupError):  # a thread that has just ended
            for child in map(int, children.read_text().split()):
                yield child
                yield from descendants(child)


def cmdline(pid: int) -> bytes:
    """Return the command of a process, its words apart by NUL; empty if it has just ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except (FileNotFoundError, ProcessLookupError):
        return b""


def panel_of(daemon: int) -> int:
    """Return the process of the panel that a daemon has started."""
    for pid in descendants(daemon):
        if b"\0panel\0" in cmdline(pid):
            return pid
    raise SystemExit("the daemon has no panel")


def enter(browser: Browser, link: str, name: str) -> Page:
    """Return a page that has been let in."""
    page = browser.new_page(viewport={"width": 1440, "height": 900})
    page.set_default_timeout(PATIENCE_MS)
    page.goto(link)
    page.get_by_label("Your name").fill(name)
    page.get_by_role("button", name="Open the panel").click()
    page.locator(".state-word").wait_for()
    return page


def invited(page: Page, name: str) -> str:
    """Return a link for another page."""
    page.get_by_role("button", name=name, exact=True).click()
    page.get_by_role("button", name="Link to watch").click()
    link = page.locator("output.link code").inner_text()
    page.get_by_role("button", name="Close").click()
    return link


def measure(page: Page, pids: dict[str, int], seconds: float) -> dict[str, float]:
    """Return ages of drawn samples in ms, frames per second, and shares of a core."""
    browser = browser_pids()
    before, begun = {name: cpu_s(pid) for name, pid in pids.items()}, time.monotonic()
    drawing_s = sum(map(cpu_s, browser))
    ages = sorted(1e3 * item for item in page.evaluate(WATCH, seconds))
    took_s = time.monotonic() - begun
    found = {name: (cpu_s(pid) - before[name]) / took_s for name, pid in pids.items()}
    found["browser"] = (sum(map(cpu_s, browser)) - drawing_s) / took_s
    return found | {
        "fps": len(ages) / seconds,
        "p50": statistics.median(ages),
        "p99": ages[int(0.99 * (len(ages) - 1))],
    }


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=10.0)
    seconds = parser.parse_args().seconds
    chromium = shutil.which("chromium")
    if chromium is None:
        raise SystemExit("chromium is missing: scripts/need chromium")
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        daemon, link, _ = stack.enter_context(served(folder))
        playwright = stack.enter_context(sync_playwright())
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        stack.callback(browser.close)
        page = enter(browser, link, "one")
        pids = {"daemon": daemon.pid, "panel": panel_of(daemon.pid)}
        page.wait_for_timeout(3000)
        for pages in (1, 3):
            while len(browser.contexts) < pages:
                number = len(browser.contexts) + 1
                enter(browser, invited(page, "one"), f"page {number}")
            found = measure(page, pids, seconds)
            where = f"{pages} page{'s' * (pages > 1)} open"
            noted(f"frames drawn, {where}", found["fps"], "1/s")
            noted(f"age of the newest sample drawn, {where}, p50", found["p50"], "ms")
            noted(f"age of the newest sample drawn, {where}, p99", found["p99"], "ms")
            for name in ("panel", "daemon", "browser"):
                noted(f"the {name}'s share of a core, {where}", 100 * found[name], "%")


if __name__ == "__main__":
    main()
