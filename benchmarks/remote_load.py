"""What viewers cost the daemon, and whether they delay the cycle.

`rigd serve` on the simulated LuGre rig with its panel, a run of minutes, and in turn, interleaved:

* no viewer;
* ten subscribers do, each with a zenoh session of its own, to every live stream;
* with them three headless Chromium pages, kept off the cycle's processor: what they compute would
  be another computer's, what they make daemon and panel do is this one's;
* the same, and the browsers compute wherever the kernel lets them.

Measured: the share of a core that daemon, panel, recorder and cycle take; how old the newest sample
of a frame is in a subscriber's callback, and in a page when it has been drawn; how late the cycle
begins. Beside it run the loops of ``cycle_peers.py``: slots in which a witness above all programs
was kept away show the host, and are left out of the figures that are called own.

    python benchmarks/remote_load.py --seconds 8 --rounds 6 --table load.jsonl
                        continues the table: stop it and start it as you like
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from time import monotonic_ns, sleep
from typing import Self

import numpy as np
from cycle_peers import HEADING, Beside, Lateness, RunningBeside, compile_witness
from figures import at_most, noted
from panel import NAME, WATCH, browser_pids, cpu_s, enter, invited, panel_of, served
from playwright.sync_api import Page, sync_playwright

from rigd.engine.shared import RunFolder, View, Word, state_folder
from rigd.engine.sink import Rows

SUBSCRIBERS = 10
PAGES = 3
#: Lateness (p99.9) with viewers, against that without.
LATENESS_RATIO = 1.2
PERIOD_NS = 1_000_000
#: Between the start of the viewers and the measurement, in s.
SETTLE_S = 1.0
#: In the order of each round.
ALONE, TEN, ELSEWHERE, HERE = (
    "no viewer",
    f"{SUBSCRIBERS} subscribers",
    f"{SUBSCRIBERS} subscribers, {PAGES} pages on another processor",
    f"{SUBSCRIBERS} subscribers, {PAGES} pages anywhere",
)
LOADS = (ALONE, TEN, ELSEWHERE, HERE)
WITH_PAGES = (ELSEWHERE, HERE)

#: Subscribes so many times on a line "on"; on "off" leaves, and prints how old, in ms, the newest
#: sample of each frame was in the callback.
CROWD = """
import json, struct, sys, time, zenoh
from rigd.remote.network import client_config
from rigd.remote.protocol import Keys
from rigd.remote.protocol.frame import HEADER

endpoint, rig, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
ages, sessions = [], []

def came(sample):
    now_ns, payload = time.time_ns(), sample.payload.to_bytes()
    *_, points, _, t0_ns = HEADER.unpack_from(payload)
    (last_s,) = struct.unpack_from("<d", payload, HEADER.size + 8 * (points - 1))
    ages.append((now_ns - t0_ns) * 1e-6 - last_s * 1e3)

for line in sys.stdin:
    if line == "on\\n":
        ages.clear()
        for _ in range(count):
            sessions.append(zenoh.open(client_config([endpoint])))
            sessions[-1].declare_subscriber(Keys(rig).every_live, came)
        print("on", flush=True)
    else:
        while sessions:
            sessions.pop().close()
        print(json.dumps(ages), flush=True)
for one in sessions:
    one.close()
"""


class Crowd:
    """Ten subscribers in a process, there or not."""

    def __init__(self, endpoint: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", CROWD, endpoint, NAME, str(SUBSCRIBERS)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def come(self) -> None:
        """Subscribe."""
        if self._told("on") != "on\n":
            raise RuntimeError("the subscribers did not come")

    def leave(self) -> list[float]:
        """Leave; return how old frames were when they came, in ms."""
        ages: list[float] = json.loads(self._told("off"))
        return ages

    def end(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()

    def _told(self, word: str) -> str:
        stdin, stdout = self._process.stdin, self._process.stdout
        if stdin is None or stdout is None:
            raise RuntimeError("it has pipes")
        stdin.write(f"{word}\n")
        stdin.flush()
        return stdout.readline()


@dataclass(frozen=True)
class Block:
    """What was seen in one stretch of time under one load; lateness is that of the cycle."""

    load: str
    shares: Mapping[str, float]  #: of a core, by process
    lateness: Lateness
    own: Lateness  #: without the slots in which the host was away
    witness: Lateness  #: of the bare loop on the cycle's processor, above all programs
    callback_ms: Sequence[float]  #: age of a sample in a subscriber: p50, p99; () without
    drawn_ms: Sequence[float]  #: the same in a page, once drawn
    drawn_per_s: float

    @classmethod
    def read(cls, line: str) -> Self:
        """Return one of a table."""
        row = json.loads(line)
        for name in ("lateness", "own", "witness"):
            row[name] = Lateness(**row[name])
        return cls(**row)


class Bench:
    """A rig that moves, and all its viewers."""

    def __init__(
        self, pids: dict[str, int], witness: Path, crowd: Crowd, pages: list[Page], seconds: float
    ) -> None:
        self._pids, self._witness, self._crowd = pids, witness, crowd
        self._pages, self._address = pages, pages[0].url.partition("#")[0]
        self._seconds = seconds
        folder = RunFolder.at(state_folder() / NAME)
        self._origin_ns = folder.board()[Word.ORIGIN_NS]
        self._cycles = View(folder.row_rings(folder.job)["cycle"])
        (self._processor,) = os.sched_getaffinity(pids["cycle"])  # it keeps to one
        for page in pages:
            page.goto("about:blank")

    def measure(self, load: str) -> Block:
        """Start the viewers of ``load``, measure, stop them."""
        pages = self._pages if load in WITH_PAGES else []
        self._place_browser(load)
        for page in pages:
            page.goto(self._address)
            page.locator(".state-word", has_text="Running").wait_for()
        if load != ALONE:
            self._crowd.come()
        sleep(SETTLE_S)
        drawn: list[float] = []
        beside = RunningBeside(self._witness, PERIOD_NS // 1000, self._seconds)
        try:
            self._cycles.read()
            before = {name: cpu_s(pid) for name, pid in self._pids.items()}
            since_ns = monotonic_ns()
            if pages:
                drawn = [1e3 * age for age in pages[0].evaluate(WATCH, self._seconds)]
            sleep(max(self._seconds - (monotonic_ns() - since_ns) * 1e-9, 0.0))
            took_s = (monotonic_ns() - since_ns) * 1e-9  # a page may take its time
            used = {name: cpu_s(pid) - before[name] for name, pid in self._pids.items()}
            rows = self._cycles.read()
            found = beside.results()
        finally:
            beside.end()
        callback = self._crowd.leave() if load != ALONE else []
        for page in pages:
            page.goto("about:blank")
        until_ns = since_ns + round(self._seconds * 1e9)  # as long as the loops beside
        cpu_us = 1e6 * used["cycle"] / len(rows)
        lateness, own = self._lateness(rows, since_ns, until_ns, found, cpu_us)
        return Block(
            load,
            {name: item / took_s for name, item in used.items()},
            lateness,
            own,
            found.witnesses[self._processor],
            quantiles(callback),
            quantiles(drawn),
            len(drawn) / took_s,
        )

    def _lateness(
        self, rows: Rows, since_ns: int, until_ns: int, beside: Beside, cpu_us: float
    ) -> tuple[Lateness, Lateness]:
        """Return that of the cycle in a span, and the same without what was the host's."""
        due_ns = np.rint(rows["scheduled"] * 1e9).astype(np.int64) + self._origin_ns
        measured = (due_ns >= since_ns) & (due_ns < until_ns)
        rows, due_ns = rows[measured], due_ns[measured]
        late_s = rows["actual"] - rows["scheduled"]
        late_us = 1e6 * late_s
        there = ~beside.was_away(due_ns, due_ns + (1e3 * late_us).astype(np.int64))
        slots = round((due_ns[-1] - due_ns[0]) / PERIOD_NS) + 1
        own = late_us[there]
        return Lateness.of(late_us, slots, cpu_us), Lateness.of(own, len(own), cpu_us)

    def _place_browser(self, load: str) -> None:
        """Keep the browser off the cycle's processor, or let it run on any."""
        allowed = os.sched_getaffinity(0)
        if load == ELSEWHERE:
            allowed -= os.sched_getaffinity(self._pids["cycle"])
        for pid in browser_pids():
            for task in Path(f"/proc/{pid}/task").iterdir():
                with suppress(ProcessLookupError):  # threads come and go
                    os.sched_setaffinity(int(task.name), allowed)


def quantiles(ages_ms: Sequence[float]) -> Sequence[float]:
    """Return p50 and p99; nothing of nothing."""
    return [float(item) for item in np.quantile(ages_ms, (0.5, 0.99))] if ages_ms else ()


def middle(found: Sequence[Lateness]) -> Lateness:
    """Return the median of each figure; slots are added up."""
    whole = [sum(item.slots for item in found), sum(item.missed for item in found)]
    names = ("p50_us", "p99_us", "p999_us", "max_us", "cpu_us")
    return Lateness(*whole, *(statistics.median(getattr(o, name) for o in found) for name in names))


def report(blocks: Sequence[Block]) -> None:
    """Print the table and the figures: medians of the blocks under one load."""
    by_load = {load: [block for block in blocks if block.load == load] for load in LOADS}
    for load, found in by_load.items():
        for name in found[0].shares:
            share = statistics.median(item.shares[name] for item in found)
            noted(f"load, {load}: {name}", 100 * share, "% of a core")
        callback, drawn = [item.callback_ms for item in found], [item.drawn_ms for item in found]
        for where, ages in (("a callback", callback), ("a page", drawn)):
            if all(ages):
                p50, p99 = (statistics.median(age[index] for age in ages) for index in (0, 1))
                noted(f"load, {load}: age of a sample in {where}, p50", p50, "ms")
                noted(f"load, {load}: age of a sample in {where}, p99", p99, "ms")
        if all(drawn):
            rate_hz = statistics.median(item.drawn_per_s for item in found)
            noted(f"load, {load}: frames drawn", rate_hz, "1/s")
    print("\nlateness in us, medians of the blocks; own: while the host was there")
    print(HEADING)
    alone: dict[str, float] = {}
    for load, found in by_load.items():
        cycle = middle([item.lateness for item in found])
        own = middle([item.own for item in found])
        witness = middle([item.witness for item in found])
        print(load)
        print(cycle.line("  cycle"))
        print(own.line("  cycle, own"))
        print(witness.line("  witness on its processor"))
        p999_us = {"": cycle.p999_us, ", own": own.p999_us, ", witness": witness.p999_us}
        if load == ALONE:
            alone = p999_us
        else:
            for what, item in p999_us.items():
                name = f"load, {load}: lateness p99.9 / alone{what}"
                if what == ", witness":
                    noted(name, item / alone[what], "x")
                else:
                    at_most(name, item / alone[what], LATENESS_RATIO)


def measured(missing: dict[str, int], seconds: float) -> Iterator[Block]:
    """Yield blocks until none is missing of any load, in turn."""
    chromium = shutil.which("chromium")
    if chromium is None:
        raise SystemExit("chromium is missing: scripts/need chromium")
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        witness = compile_witness(folder)
        daemon, link, endpoint = stack.enter_context(served(folder))
        playwright = stack.enter_context(sync_playwright())
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        stack.callback(browser.close)
        crowd = Crowd(endpoint)
        stack.callback(crowd.end)
        pages = [enter(browser, link, "one")]
        for number in range(1, PAGES):
            pages.append(enter(browser, invited(pages[0], "one"), f"page {number}"))
        board = RunFolder.at(state_folder() / NAME).board()
        pids = {
            "daemon": daemon.pid,
            "panel": panel_of(daemon.pid),
            "recorder": board[Word.PID_RECORDER],
            "cycle": board[Word.PID_CYCLE],
        }
        bench = Bench(pids, witness, crowd, pages, seconds)
        while max(missing.values()) > 0:
            load = max(LOADS, key=lambda item: missing[item])
            yield bench.measure(load)
            missing[load] -= 1


def main() -> int:
    """Measure as many rounds as are missing from the table, then print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=8.0, help="of a block")
    parser.add_argument("--rounds", type=int, default=6, help="of a block under each load")
    parser.add_argument("--table", type=Path, default=None, help="file of what is done already")
    args = parser.parse_args()
    blocks: list[Block] = []
    if args.table is not None and args.table.exists():
        blocks = [Block.read(line) for line in args.table.read_text().splitlines()]
    missing = {load: args.rounds - sum(item.load == load for item in blocks) for load in LOADS}
    for block in measured(missing, args.seconds) if max(missing.values()) > 0 else ():
        blocks.append(block)
        if args.table is not None:
            with args.table.open("a") as table:
                table.write(json.dumps(asdict(block)) + "\n")
        print(f"{block.load}: done, {args.rounds * len(LOADS) - len(blocks)} to go", flush=True)
    report(blocks)
    return 0


if __name__ == "__main__":
    sys.exit(main())
