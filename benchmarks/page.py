"""What the tab of a run costs, for as long as it is asked: processor, network and memory.

`rigd serve` on the simulated LuGre rig, its panel, and a headless Chromium with one page that shows
a run of many hours. Each interval gives a row: the share of a core of the tab (its renderer), of
the browser's process that draws (by software here), of the panel and the daemon; what the page
received; the memory of the tab (PSS: what it shares with others is counted in part), and what of
it are JavaScript objects, array buffers and elements of the page, by the browser's own counters.
The browser is asked for these once in an interval and by nothing else: a tool that listens to all
messages of a page has a part in what the page takes.

    python benchmarks/page.py --minutes 60
    python benchmarks/page.py --minutes 10 --every 30 --width 390 --height 844

A tab is flat if it keeps no more than 10 MB more in the hour that follows its first ten minutes.
What it keeps is its memory behind a collection of garbage, which is asked for twice: after these
minutes (at the begin, if less is measured) and at the end. Between, the browser collects when it
likes: with memory to spare it lets its heap of page objects fill for an hour.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import signal
import subprocess
import tempfile
import time
import urllib.request
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from figures import at_most, noted
from panel import cmdline, cpu_s, descendants, panel_of, served
from websockets.sync.client import connect

#: What a tab may take.
CORE_PERCENT = 15.0
GB_PER_HOUR = 0.1
MB_PER_HOUR = 10.0
#: Before that the tab fills what it keeps, in minutes.
FILLING_MIN = 10.0
#: Lets a user in; the result is the state that the page then shows.
ENTER = """(() => {
  const name = document.querySelector("#login-name");
  if (name && !name.value) {
    name.value = "one";
    name.form.requestSubmit();
  }
  return document.querySelector(".state-word")?.textContent ?? "";
})()"""

#: Counts what the page receives, from its next answer on.
COUNT = """(() => {
  const known = new WeakSet();
  const { send } = WebSocket.prototype;
  globalThis.received = 0;
  WebSocket.prototype.send = function (text) {
    if (!known.has(this)) {
      known.add(this);
      this.addEventListener("message", ({ data }) => {
        received += data.byteLength ?? data.length;
      });
    }
    return send.call(this, text);
  };
})()"""


class Row(NamedTuple):
    """What one interval gave: shares in percent of a core, sizes in MB."""

    minutes: float
    tab: float
    drawing: float
    panel: float
    daemon: float
    hourly: float
    memory: float
    objects: float
    buffers: float
    elements: int
    drawn: int


class Tab:
    """The page in a browser of its own."""

    def __init__(self, port: int, browser: int) -> None:
        self.port = port
        self.browser = browser

    def ask(self, *calls: tuple[str, dict[str, Any]]) -> list[dict[str, Any]]:
        """Return what the browser answers to calls of its protocol, over a connection of theirs."""
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/json/list") as answer:
            (page,) = [item for item in json.load(answer) if item["type"] == "page"]
        found = []
        with connect(page["webSocketDebuggerUrl"], max_size=None) as socket:
            for number, (method, params) in enumerate(calls):
                socket.send(json.dumps({"id": number, "method": method, "params": params}))
                while (told := json.loads(socket.recv(600))).get("id") != number:
                    pass
                found.append(told.get("result", {}))
        return found

    def value(self, expression: str) -> Any:
        """Return what a piece of JavaScript gives; None if the page could not compute it."""
        (found,) = self.ask(("Runtime.evaluate", {"expression": expression}))
        return found.get("result", {}).get("value")

    def kept_mb(self) -> float:
        """Let the browser collect its garbage; return the memory of the tab then, in MB."""
        for _ in range(2):  # what the first frees lets go of others
            self.ask(("HeapProfiler.collectGarbage", {}))
        time.sleep(3)
        return sum(mapped_kb(self.process("renderer")).values()) / 1024

    def process(self, kind: str) -> int:
        """Return the process of the browser that has a kind: that with most work of several."""
        pids = descendants(self.browser)
        found = [pid for pid in pids if f"--type={kind}".encode() in cmdline(pid)]
        return max(found, key=cpu_s)


@contextmanager
def opened(link: str, folder: Path, width: int, height: int) -> Iterator[Tab]:
    """Open the panel in a headless Chromium; none of its processes is left behind."""
    chromium = shutil.which("chromium")
    if chromium is None:
        raise SystemExit("chromium is missing: scripts/need chromium")
    browser = subprocess.Popen(
        [chromium, "--headless=new", "--no-sandbox", "--remote-debugging-port=0",
         f"--user-data-dir={folder}", f"--window-size={width},{height}", "--hide-scrollbars",
         "--force-device-scale-factor=1", "--disable-extensions", link],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        told = folder / "DevToolsActivePort"
        while not told.is_file() or not told.read_text():
            if browser.poll() is not None:
                raise SystemExit("the browser did not start")
            time.sleep(0.2)
        tab = Tab(int(told.read_text().splitlines()[0]), browser.pid)
        while tab.value(ENTER) != "Running":
            time.sleep(1)
        yield tab
    finally:
        browser.send_signal(signal.SIGTERM)
        browser.wait(30)


def mapped_kb(pid: int) -> Counter[str]:
    """Return the PSS of a process in kB by what is mapped."""
    found: Counter[str] = Counter()
    name = ""
    for line in Path(f"/proc/{pid}/smaps").read_text().splitlines():
        words = line.split()
        if "-" in words[0]:
            name = words[5] if len(words) > 5 else "anonymous"
        elif words[0] == "Pss:":
            found[re.sub(r"\d+", "N", name)] += int(words[1])
    return found


def watch(tab: Tab, daemon: int, seconds: float, every_s: float) -> list[Row]:
    """Return a row for each interval; print what the tab keeps."""
    time.sleep(5)
    renderer = tab.process("renderer")
    pids = {
        "tab": renderer, "drawing": tab.process("gpu-process"),
        "panel": panel_of(daemon), "daemon": daemon,
    }  # fmt: skip
    tab.value(COUNT)
    rows: list[Row] = []
    kept: list[tuple[float, float]] = []
    filling_min = FILLING_MIN if seconds > 120 * FILLING_MIN else 0.0
    maps = mapped_kb(renderer)
    begun = before_s = time.monotonic()
    before = {name: cpu_s(pid) for name, pid in pids.items()}
    received = 0.0
    print(" ".join(f"{name:>9}" for name in Row._fields), flush=True)
    while time.monotonic() < begun + seconds:
        if not kept and time.monotonic() >= begun + 60 * filling_min:
            kept.append((time.monotonic(), tab.kept_mb()))
        time.sleep(every_s)
        now_s = time.monotonic()
        now = {name: cpu_s(pid) for name, pid in pids.items()}
        grown = mapped_kb(renderer)
        heap, counters = tab.ask(("Runtime.getHeapUsage", {}), ("Memory.getDOMCounters", {}))
        now_received = float(tab.value("received"))
        rows.append(
            Row(
                minutes=(now_s - begun) / 60,
                hourly=(now_received - received) / 1e6 * 3600 / (now_s - before_s),
                memory=sum(grown.values()) / 1024,
                objects=heap["usedSize"] / 1e6,
                buffers=heap.get("backingStorageSize", float("nan")) / 1e6,
                elements=counters["nodes"],
                drawn=int(tab.value("document.querySelector('.traces').dataset.drawn")),
                **{name: 100 * (now[name] - before[name]) / (now_s - before_s) for name in pids},
            )
        )
        print(" ".join(f"{value:9.4g}" for value in rows[-1]), flush=True)
        before, before_s, received = now, now_s, now_received
    print("what grew, in MB:")
    grown.subtract(maps)
    for name, size in grown.most_common(4):
        print(f"{size / 1024:9.1f} {name}")
    kept.append((time.monotonic(), tab.kept_mb()))
    (since_s, before_mb), (until_s, after_mb) = kept
    noted("kept by the tab, first", before_mb, "MB")
    noted("kept by the tab, last", after_mb, "MB")
    if filling_min:
        hourly = 3600 * (after_mb - before_mb) / (until_s - since_s)
        at_most("growth of what the tab keeps, in an hour", hourly, MB_PER_HOUR, "MB")
    return rows


def report(rows: list[Row]) -> None:
    """Print the figures."""
    middle = {name: float(np.median([getattr(row, name) for row in rows])) for name in Row._fields}
    at_most("the tab's share of a core", middle["tab"], CORE_PERCENT, "%")
    noted("the drawing process's share of a core", middle["drawing"], "%")
    noted("the panel's share of a core, one page", middle["panel"], "%")
    noted("the daemon's share of a core, one page", middle["daemon"], "%")
    at_most("sent to the page in an hour", middle["hourly"] / 1e3, GB_PER_HOUR, "GB")
    noted("memory of the tab at the end", rows[-1].memory, "MB")


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--every", type=float, default=30.0, help="s between the rows")
    parser.add_argument("--width", type=int, default=1280)
    parser.add_argument("--height", type=int, default=800)
    args = parser.parse_args()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        daemon, link, _ = stack.enter_context(served(folder))
        profile = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
        tab = stack.enter_context(opened(link, Path(profile), args.width, args.height))
        report(watch(tab, daemon.pid, 60 * args.minutes, args.every))


if __name__ == "__main__":
    main()
