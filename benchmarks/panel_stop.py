"""From a press on Stop in the panel's page to a current of zero and its confirmation.

`rigd serve` on the simulated LuGre rig in real time, its panel, and a page in headless Chromium,
which draws. One run after the other is stopped by a press on the page's own button, with no other
client there and, in turn, with ten further pages that take every frame beside a flood. Measured
from the press: until the recording shows the first cycle that commands a current of zero, and until
the page shows the stop as confirmed by the daemon.

The witness is asked by the same page, just before each press: a server of a few lines that answers
every request at once, in a process of its own. What it takes longer under load is the machine's and
the browser's; the rest is rigd's.

    python benchmarks/panel_stop.py --rounds 100
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import multiprocessing
import shutil
import statistics
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from http.client import HTTPConnection
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

import numpy as np
from figures import at_most, noted
from panel import NAME, PATIENCE_MS, invited, move, served
from playwright.sync_api import Browser, Page, sync_playwright
from websockets import Origin
from websockets.asyncio.client import connect

from rigd.record import Recording
from rigd.remote import Client

#: Pages that watch; of one session there may be eight.
WATCHERS, OF_ONE = 10, 5
#: Connections of the flood; each asks as soon as it is answered.
FLOOD = 4
#: Press to confirmation under load, against the same in peace.
MOST_RATIO = 3.0
#: Fewer stops have no 99th percentile but their worst.
LEAST_FOR_P99 = 100
TITLES = {
    "witness": "the witness",
    "confirmed": "press on Stop to confirmation",
    "zero": "press on Stop to zero current",
}

#: Resolves with the time of the press, UTC in ms, and ms from there to the confirmation.
PRESSED = """() => new Promise((done) => {
  const result = document.querySelector(".stop-result");
  let at = null;
  const press = (event) => { at = event.timeStamp; };
  window.addEventListener("pointerdown", press, {capture: true, once: true});
  const watch = new MutationObserver(() => {
    if (at === null || result.dataset.mood === "ask") return;
    watch.disconnect();
    done([performance.timeOrigin + at, performance.now() - at]);
  });
  watch.observe(result, {attributes: true, childList: true});
})"""
#: Resolves with ms until the witness has answered.
WITNESS = """async (address) => {
  const begun = performance.now();
  await fetch(address, {method: "POST", mode: "no-cors", body: "{}"});
  return performance.now() - begun;
}"""


def witness(reply: multiprocessing.connection.Connection) -> None:
    """Answer every request at once, until killed."""

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(ConnectionError, asyncio.IncompleteReadError):
            while True:
                head = await reader.readuntil(b"\r\n\r\n")
                length = head.lower().partition(b"content-length: ")[2].partition(b"\r")[0]
                await reader.readexactly(int(length or 0))
                writer.write(b"HTTP/1.1 200 OK\r\ncontent-length: 2\r\n\r\n{}")
                await writer.drain()

    async def run() -> None:
        server = await asyncio.start_server(answer, "127.0.0.1", 0)
        reply.send(server.sockets[0].getsockname()[1])
        await server.serve_forever()

    asyncio.run(run())


def crowd(address: str, cookies: Sequence[str]) -> None:
    """Watch with ten pages, and flood, until killed."""
    place = urlsplit(address)

    async def look(cookie: str) -> None:
        async with connect(
            f"ws://{place.netloc}/api/live",
            origin=Origin(f"http://{place.netloc}"),
            additional_headers={"cookie": cookie},
            max_size=None,
        ) as page:
            async for message in page:
                if isinstance(message, bytes):
                    await page.send("drawn")

    async def flood() -> None:
        request = f"GET /api/session HTTP/1.1\r\nhost: {place.netloc}\r\n\r\n".encode()
        reader, writer = await asyncio.open_connection(place.hostname, place.port)
        while True:
            writer.write(request)
            head = await reader.readuntil(b"\r\n\r\n")
            length = head.lower().partition(b"content-length: ")[2].partition(b"\r")[0]
            await reader.readexactly(int(length))

    async def run() -> None:
        await asyncio.gather(
            *(look(cookie) for cookie in cookies), *(flood() for _ in range(FLOOD))
        )

    asyncio.run(run())


def cookie_of(link: str) -> str:
    """Log in, and return the cookie."""
    address, _, code = link.partition("#")
    place = urlsplit(address)
    connection = HTTPConnection(place.netloc, timeout=60)
    body = json.dumps({"code": code, "name": "watcher"})
    headers = {
        "origin": f"http://{place.netloc}", "x-rigd": "1", "content-type": "application/json",
    }  # fmt: skip
    connection.request("POST", "/api/login", body, headers)
    answer = connection.getresponse()
    if answer.status != 200:
        raise SystemExit(f"a watcher was not let in: {answer.read()!r}")
    return str(answer.headers["set-cookie"]).partition(";")[0]


@contextmanager
def crowded(address: str, cookies: Sequence[str]) -> Iterator[None]:
    """Let the crowd be there."""
    others = multiprocessing.get_context("spawn").Process(target=crowd, args=(address, cookies))
    others.start()
    try:
        yield
        if not others.is_alive():
            raise SystemExit("the crowd has left early")
    finally:
        others.kill()
        others.join()


def enter_unbound(browser: Browser, link: str) -> Page:
    """Return a page that has been let in, and may ask the witness too."""
    page = browser.new_context(viewport={"width": 1440, "height": 900}, bypass_csp=True).new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(link)
    page.get_by_label("Your name").fill("one")
    page.get_by_role("button", name="Open the panel").click()
    page.locator(".state-word").wait_for()
    return page


class Stopped(NamedTuple):
    """How long parts of a stop took, in ms."""

    witness: float
    confirmed: float
    zero: float


def stopped(page: Page, endpoint: str, address: str, runs: Path) -> Stopped:
    """Stop the run under way, and start another."""
    page.locator(".state-word", has_text="Running").wait_for()
    page.wait_for_timeout(700)  # the same press again within 0.7 s is none
    beside = float(page.evaluate(WITNESS, address))
    pressed = page.evaluate_handle(f"() => ({{promise: ({PRESSED})()}})")
    page.locator(".stop-stop").click()
    pressed_ms, confirmed = pressed.evaluate("pressed => pressed.promise")
    with Client(NAME, endpoint=endpoint) as client:
        next(item for item in client.watch() if item.state == "idle")
    rows = Recording.open(max(runs.glob("*.mcap"))).read("wheel_servo")
    moved = int(np.flatnonzero(rows["current_setpoint"])[-1])
    zero = rows["t_ns"][moved + 1] / 1e6 - pressed_ms
    move(endpoint)
    return Stopped(beside, confirmed, zero)


def report(case: str, stops: Sequence[Stopped]) -> None:
    """Print the medians, the 99th percentiles and the worst."""
    for name in Stopped._fields:
        values = [getattr(item, name) for item in stops]
        noted(f"{TITLES[name]}, {case}, p50", statistics.median(values), "ms")
        if len(values) >= LEAST_FOR_P99:
            noted(f"{TITLES[name]}, {case}, p99", p99(values), "ms")
        noted(f"{TITLES[name]}, {case}, worst of {len(values)}", max(values), "ms")


def p99(values: Sequence[float]) -> float:
    """Return the 99th percentile: the least value that 99 % of ``values`` do not exceed."""
    return sorted(values)[math.ceil(0.99 * len(values)) - 1]


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=100)
    rounds = parser.parse_args().rounds
    chromium = shutil.which("chromium")
    if chromium is None:
        raise SystemExit("chromium is missing: scripts/need chromium")
    spawn = multiprocessing.get_context("spawn")
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        _, link, endpoint = stack.enter_context(served(folder))
        ours, theirs = spawn.Pipe()
        server = spawn.Process(target=witness, args=(theirs,), daemon=True)
        server.start()
        stack.callback(server.kill)
        address = f"http://127.0.0.1:{ours.recv()}/"
        browser = stack.enter_context(sync_playwright()).chromium.launch(
            executable_path=chromium, args=["--no-sandbox"]
        )
        stack.callback(browser.close)
        page = enter_unbound(browser, link)
        sessions = [cookie_of(invited(page, "one")) for _ in range(WATCHERS // OF_ONE)]
        cookies = [session for session in sessions for _ in range(OF_ONE)]
        quiet, loaded = [], []
        for _ in range(rounds):
            quiet.append(stopped(page, endpoint, address, folder / "runs"))
            with crowded(link.partition("#")[0], cookies):
                loaded.append(stopped(page, endpoint, address, folder / "runs"))
    report("no other client", quiet)
    report(f"{WATCHERS} watch and {FLOOD} flood", loaded)
    for name in ("zero", "confirmed"):
        in_peace, in_crowd = ([getattr(item, name) for item in stops] for stops in (quiet, loaded))
        title = f"{TITLES[name]}, in a crowd against in peace"
        ratio = statistics.median(in_crowd) / statistics.median(in_peace)
        at_most(f"{title}, p50", ratio, MOST_RATIO)
        if rounds >= LEAST_FOR_P99:
            at_most(f"{title}, p99", p99(in_crowd) / p99(in_peace), MOST_RATIO)


if __name__ == "__main__":
    main()
