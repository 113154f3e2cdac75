"""Five rigs on one computer: what a page's control, a stop command and the cycles suffer.

A rig with its panel, a page that has control, and a run that moves; beside it four daemons whose
runs are started together, again and again. All are simulated LuGre rigs in real time, at 1 kHz.

* Renewals: the time between two renewals of the page's control, as the status shows them, while
  the four start; control is lost after 6 s.
* Cycles: slots that each of the four missed, beside witnesses above all programs, one for each
  processor: what these miss is the host's.
* `rigd remote stop` from its launch until the daemon has it (its notice), with all runs under way,
  and on a rig without neighbours.

    python benchmarks/four_rigs.py --rounds 13
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from http.client import HTTPConnection
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import numpy as np
from cycle_peers import RunningBeside, compile_witness
from figures import at_most, noted
from flood import HOLD
from panel import NAME, served
from panel_stop import cookie_of
from support.daemon.process import Daemon
from support.daemon.served_rig import free_port
from support.wire import ROOT
from websockets import Origin
from websockets.sync.client import connect

from rigd.engine.shared import Word
from rigd.engine.shared.folder import STATE_VARIABLE
from rigd.remote import Client
from rigd.remote.protocol.limits import LEASE_S

RIGS: Final = 4
#: Missed slots of a rig beside three others, own ones, as a share.
MOST_MISSED: Final = 0.005
#: A stop leaves the shell and reaches the daemon within this on a quiet machine, in ms.
MOST_STOP_MS: Final = 150.0
STOPS: Final = 20
#: The end of one lease is told alike within this, by clocks that are read one after the other.
SAME_NS: Final = 100_000_000


class Renewals(threading.Thread):
    """Notes when the control of a rig was renewed, on the monotonic clock."""

    def __init__(self, endpoint: str) -> None:
        super().__init__(daemon=True)
        self._client = Client(NAME, endpoint=endpoint)
        self.at_s: list[float] = []
        self.lost = 0
        self.ending = False

    def run(self) -> None:
        """Watch until the end."""
        until_ns = 0
        for status in self._client.watch():
            if self.ending:
                return
            if status.lease.holder is None:
                self.lost += until_ns > 0
                until_ns = 0
            elif status.lease.until_ns - until_ns > SAME_NS:
                until_ns = status.lease.until_ns
                self.at_s.append(until_ns * 1e-9 - LEASE_S)

    def end(self) -> None:
        """Watch no more."""
        self.ending = True
        self.join(10)
        self._client.close()


@contextmanager
def page(link: str) -> Iterator[None]:
    """A page of the panel that has control, and is open."""
    place, cookie = urlsplit(link), cookie_of(link)
    origin = f"http://{place.netloc}"
    headers = {
        "origin": origin, "x-rigd": "1", "content-type": "application/json", "cookie": cookie,
    }  # fmt: skip
    with connect(
        f"ws://{place.netloc}/api/live",
        origin=Origin(origin),
        additional_headers={"cookie": cookie},
        max_size=None,
    ) as live:
        ended = threading.Event()

        def take() -> None:
            while not ended.is_set():
                try:
                    message = live.recv(timeout=1.0)
                except TimeoutError:
                    continue
                if isinstance(message, bytes):
                    live.send("drawn")

        thread = threading.Thread(target=take)
        thread.start()
        connection = HTTPConnection(place.netloc, timeout=60)
        connection.request("POST", "/api/command/lease_take", json.dumps({"args": {}}), headers)
        answer = connection.getresponse()
        if answer.status != 200:
            raise SystemExit(f"the page got no control: {answer.read()!r}")
        try:
            yield
        finally:
            ended.set()
            thread.join()


def daemon_of(folder: Path, name: str) -> Daemon:
    """Serve another rig."""
    folder.mkdir()
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    text = (ROOT / "configs/sim_lugre.yaml").read_text()
    text = text.replace("parameters: plants/", f"parameters: {ROOT}/configs/plants/")
    text = text.replace("rig: lugre-1", f"rig: {name}")
    text = text.replace("stale_after: 20 ms", "stale_after: 500 ms")  # a shared host may be away
    rig, state = folder / "rig.yaml", folder / "state"
    rig.write_text(f"{text}\nremote: {{listen: [{endpoint}]}}\n")
    state.mkdir(mode=0o700)
    (folder / "runs").mkdir()
    daemon = Daemon(rig, name, endpoint, folder, state)
    daemon.notified("READY=1")
    return daemon


def start_all(daemons: list[Daemon]) -> None:
    """Start a run on each, all at once; return once all move."""
    for daemon in daemons:
        daemon.start(HOLD, on_client_loss="continue")
    for daemon in daemons:
        daemon.until(lambda status: status["step"] == "hold", steered=False)


def stop_all(daemons: list[Daemon]) -> None:
    """Stop them all."""
    for daemon in daemons:
        daemon.request("stop", "stop")
    for daemon in daemons:
        daemon.until(lambda status: status["state"] == "idle", steered=False)


def from_shell_ms(daemon: Daemon) -> float:
    """Return how long `rigd remote stop` took from its launch to the daemon's notice of it, ms."""
    begun_ns = time.time_ns()
    words = [sys.executable, "-m", "rigd", "remote", "stop", "--endpoint", daemon.endpoint]
    subprocess.run(words, check=True, capture_output=True)
    said = [item for item in daemon.status["notices"] if item["text"].startswith("stop by")]
    return float(said[-1]["t_ns"] - begun_ns) / 1e6


def stops_ms(daemon: Daemon, count: int) -> list[float]:
    """Return that of some stops, each of a run of its own."""
    found = []
    for _ in range(count):
        daemon.start(HOLD, on_client_loss="continue")
        daemon.until(lambda status: status["step"] == "hold")
        found.append(from_shell_ms(daemon))
        daemon.until(lambda status: status["state"] == "idle", steered=False)
    return found


def cycles(daemons: list[Daemon], witness: Path, seconds: float) -> None:
    """Print what the cycles miss, and the witnesses beside them."""
    boards = [daemon.folder.board() for daemon in daemons]
    beside = RunningBeside(witness, 1000, seconds)
    try:
        before = [(board[Word.CYCLES], board[Word.MISSED]) for board in boards]
        time.sleep(seconds)
        after = [(board[Word.CYCLES], board[Word.MISSED]) for board in boards]
        found = beside.results()
    finally:
        beside.end()
    shares = []
    for daemon, board, (ran, missed), (ran_on, missed_on) in zip(
        daemons, boards, before, after, strict=True
    ):
        slots = ran_on - ran + missed_on - missed
        shares.append((missed_on - missed) / slots)
        (processor,) = os.sched_getaffinity(board[Word.PID_CYCLE])
        noted(f"{daemon.name}: missed of {slots}, on processor {processor}", missed_on - missed, "")
    for processor, lateness in found.witnesses.items():
        noted(f"witness on processor {processor}: missed of {lateness.slots}", lateness.missed, "")
        noted(f"witness on processor {processor}: longest", 1e-3 * lateness.max_us, "ms")
    host = max(item.missed / item.slots for item in found.witnesses.values())
    at_most("cycles missed beside three others, worst, less the witness", max(shares) - host,
            MOST_MISSED, "")  # fmt: skip


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=13, help="starts of all four")
    parser.add_argument("--seconds", type=float, default=20.0, help="of the cycles together")
    parser.add_argument("--stops", type=int, default=STOPS)
    args = parser.parse_args()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        witness = compile_witness(folder)
        quiet = stack.enter_context(daemon_of(folder / "quiet", "quiet-1"))
        alone = stops_ms(quiet, args.stops)
        (folder / "page").mkdir()
        (folder / "state").mkdir(mode=0o700)
        os.environ[STATE_VARIABLE] = str(folder / "state")  # another bench may use its name
        _, link, endpoint = stack.enter_context(served(folder / "page"))
        stack.enter_context(page(link))
        daemons = [quiet] + [
            stack.enter_context(daemon_of(folder / f"rig{n}", f"rig-{n}")) for n in range(2, 5)
        ]
        renewals = Renewals(endpoint)
        renewals.start()
        begun_s = time.time()
        for number in range(args.rounds):
            start_all(daemons)
            if number < args.rounds - 1:
                stop_all(daemons)
            print(f"start {number + 1}, load {os.getloadavg()[0]:.1f}", flush=True)
        took_s = time.time() - begun_s
        at_s = [item for item in renewals.at_s if item >= begun_s]
        gaps_s = np.diff(at_s)
        noted("page's control: renewals seen while four rigs started", len(at_s), "")
        noted("page's control: time of these starts", took_s, "s")
        noted("page's control: between two renewals, p50", float(np.median(gaps_s)), "s")
        at_most("page's control: between two renewals, longest", float(gaps_s.max()), LEASE_S, "s")
        at_most("page's control: lost", renewals.lost, 0, "")
        renewals.end()
        cycles(daemons, witness, args.seconds)
        beside = [from_shell_ms(quiet)]
        quiet.until(lambda status: status["state"] == "idle", steered=False)
        beside += stops_ms(quiet, args.stops - 1)
        stop_all(daemons[1:])
    at_most("rigd remote stop to the daemon, alone, p50", statistics.median(alone),
            MOST_STOP_MS, "ms")  # fmt: skip
    noted("rigd remote stop to the daemon, beside four rigs, p50", statistics.median(beside), "ms")
    noted("rigd remote stop to the daemon, beside four rigs, p99",
          float(np.percentile(beside, 99)), "ms")  # fmt: skip


if __name__ == "__main__":
    main()
