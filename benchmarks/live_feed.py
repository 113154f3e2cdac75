"""What it costs to show a run while it runs: the feed, its subscribers on zenoh, and Foxglove.

A process stands for the cycle and fills the rings of two shipped rigs: one with eight streams at
1 kHz, one with ten channels at 9600 Hz beside four streams at 1 kHz. Measured for each: the share
of a core that the daemon's side takes, alone, with a zenoh subscriber and with a Foxglove client
to every stream; how old the newest sample of a frame is when it is handed over; and what a push
costs the cycle with and without a viewer, interleaved.

    python benchmarks/live_feed.py --seconds 10
"""

from __future__ import annotations

import argparse
import json
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
from figures import at_most, noted

from rigd.config.loader import load_rig
from rigd.config.remote import RemoteSetup
from rigd.config.rig import RigConfig
from rigd.daemon.live import Feed
from rigd.daemon.live.foxglove import FoxgloveServer
from rigd.engine.cycle.wiring import streams_of
from rigd.engine.row_rates import most_rows_hz
from rigd.engine.shared import Job, RunFolder, Word
from rigd.remote.protocol import RigEvent
from rigd.remote.protocol.frame import HEADER
from rigd.remote.server import Lease, Server

RIGS = ("lugre-1", "angle-1")
#: Stands for the cycle; prints the median cost of pushing one row, ns. Streams above 2 kHz come
#: in blocks of 10 ms, as from a DAQ's library. It releases what it pushed, like a recorder.
WRITER = """
import json, signal, sys, time
from pathlib import Path
import numpy as np
from rigd.engine.shared import RunFolder, Word
from rigd.model.rows import row_dtype

folder, rates = RunFolder.at(Path(sys.argv[1])), json.loads(sys.argv[2])
board, job = folder.board(), folder.job
offset = board[Word.START_NS] - board[Word.ORIGIN_NS]
single = [r for n, r in folder.row_rings(job).items() if rates[n] <= 2000]
blocks = [r for n, r in folder.row_rings(job).items() if rates[n] > 2000]
rows_of = [(0.25,) * len(r.stream.channels) + (3,) * r.stream.has_status for r in single]
n, due, costs = 0, time.monotonic_ns(), []
stop = []
signal.signal(signal.SIGTERM, lambda *_: stop.append(True))
while not stop:
    due += 1_000_000
    time.sleep(max(due - time.monotonic_ns(), 0) * 1e-9)
    t_ns = offset + due
    began = time.perf_counter_ns()
    for ring, row in zip(single, rows_of):
        ring.push(t_ns, row)
    costs.append(time.perf_counter_ns() - began)
    for ring in blocks if n % 10 == 9 else ():
        rows = np.zeros(round(rates[ring.stream.name] / 100), row_dtype(ring.stream))
        rows["t_ns"] = np.linspace(t_ns - 10_000_000, t_ns, len(rows)).astype("i8")
        ring.push_block(rows)
    if n % 100 == 99:
        for ring in single + blocks:
            ring.release(ring.head - ring.tail)
    n += 1
    board[Word.CYCLES] = n
print(sorted(costs)[len(costs) // 2] / len(single))
"""

#: Subscribes to all frames, and counts them.
SUBSCRIBER = """
import sys, zenoh
from rigd.remote.network import client_config
from rigd.remote.protocol import Keys
seen = []
with zenoh.open(client_config([sys.argv[1]])) as session:
    subscriber = session.declare_subscriber(Keys(sys.argv[2]).every_live, seen.append)
    print("ready", flush=True)
    sys.stdin.read()
    subscriber.undeclare()
print(len(seen))
"""

#: Subscribes to every topic, and counts the samples.
VIEWER = """
import json, sys
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
with connect(sys.argv[1], subprotocols=["foxglove.sdk.v1"], max_size=None) as client:
    while (announced := json.loads(client.recv()))["op"] != "advertise":
        pass
    wanted = [{"id": i, "channelId": one["id"]} for i, one in enumerate(announced["channels"])]
    client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    print("ready", flush=True)
    count = 0
    try:
        while True:
            count += isinstance(client.recv(), bytes)
    except ConnectionClosed:
        print(count)
"""


class Aged:
    """Takes frames, and notes how old the newest sample of each was."""

    def __init__(self) -> None:
        self.ages_ms: list[float] = []
        self.now: Callable[[], int] = time.time_ns

    def frame(self, stream: str, payload: bytes, /) -> None:
        """Note the age of its last point."""
        *_, points, _, t0_ns = HEADER.unpack_from(payload)
        (last_s,) = struct.unpack_from("<d", payload, HEADER.size + 8 * (points - 1))
        self.ages_ms.append((self.now() - t0_ns) * 1e-6 - last_s * 1e3)

    def event(self, event: RigEvent, /) -> None:
        """Ignore it."""


@contextmanager
def pushed(rig: RigConfig) -> Iterator[tuple[RunFolder, list[float]]]:
    """Fill the rings of a run in a folder; the list gets the cost of a push at the end, ns."""
    streams = streams_of(rig)
    with tempfile.TemporaryDirectory(dir="/dev/shm") as path:
        folder, costs = RunFolder.at(Path(path)), list[float]()
        rates = {stream.name: most_rows_hz(rig, stream) for stream in streams}
        job = Job(rig.name, Path(path) / "none.mcap", tuple(streams), time.time_ns())
        folder.prepare(job, {name: round(rate * 5) + 1000 for name, rate in rates.items()})
        board = folder.board()
        writer = subprocess.Popen(
            [sys.executable, "-c", WRITER, path, json.dumps(rates)], stdout=subprocess.PIPE
        )
        try:
            while board[Word.CYCLES] < 200:
                time.sleep(0.05)
            yield folder, costs
        finally:
            writer.terminate()
            out, _ = writer.communicate(timeout=30)
        costs.append(float(out))


@contextmanager
def looking_on(script: str, *arguments: str) -> Iterator[list[int]]:
    """Run a client in a process of its own; the list gets what it has counted at the end."""
    client = subprocess.Popen(
        [sys.executable, "-c", script, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    counted: list[int] = []
    assert client.stdin is not None and client.stdout is not None
    if client.stdout.readline().strip() != "ready":
        raise RuntimeError(f"a client did not begin: {arguments}")
    yield counted
    client.stdin.close()
    counted.append(int(client.stdout.read()))
    client.wait(30)


def share(feed: Feed, seconds: float) -> float:
    """Return the share of a core that this process takes while ``feed`` shows, in %."""
    with feed:
        time.sleep(0.5)
        began, used = time.monotonic(), time.process_time()
        time.sleep(seconds)
        return 100 * (time.process_time() - used) / (time.monotonic() - began)


def alone(rig: RigConfig, seconds: float) -> None:
    """The feed without a viewer, and how old its frames are."""
    with pushed(rig) as (folder, _):
        aged = Aged()
        feed = Feed(rig, aged)
        feed.attach(folder)
        aged.now = lambda: feed.t_ns
        used = share(feed, seconds)
    at_most(f"live {rig.name}: feed alone", used, 5, "% of a core")
    noted(f"live {rig.name}: frames", len(aged.ages_ms) / (seconds + 0.5), "/s")
    noted(f"live {rig.name}: newest sample of a frame, p50", np.median(aged.ages_ms), "ms old")
    noted(f"live {rig.name}: the same, p99", np.quantile(aged.ages_ms, 0.99), "ms old")


def with_subscriber(rig: RigConfig, seconds: float) -> None:
    """The feed with a zenoh subscriber to all frames."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with ExitStack() as stack:
        folder, _ = stack.enter_context(pushed(rig))
        server = Server(rig.name, RemoteSetup((endpoint,)), Lease())
        stack.callback(server.close)
        counted = stack.enter_context(looking_on(SUBSCRIBER, endpoint, rig.name))
        feed = Feed(rig, server.publisher)
        feed.attach(folder)
        used = share(feed, seconds)
    at_most(f"live {rig.name}: feed with a zenoh subscriber", used, 10, "% of a core")
    noted(f"live {rig.name}: frames that it got", counted[0] / (seconds + 0.5), "/s")


def with_foxglove(rig: RigConfig, seconds: float) -> None:
    """The feed with a Foxglove client to all streams."""
    with ExitStack() as stack:
        folder, _ = stack.enter_context(pushed(rig))
        server = FoxgloveServer(rig, 0)
        counted = stack.enter_context(looking_on(VIEWER, server.address))
        stack.callback(server.stop)
        feed = Feed(rig, Aged(), raw=server.show)
        feed.attach(folder)
        used = share(feed, seconds)
    noted(f"live {rig.name}: feed with a Foxglove client", used, "% of a core")
    noted(f"live {rig.name}: samples that it got", counted[0] / (seconds + 0.5), "/s")


def cost_to_the_cycle(rig: RigConfig, seconds: float, rounds: int = 3) -> None:
    """What a push takes with the feed looking on, and without."""
    costs: dict[bool, list[float]] = {False: [], True: []}
    for number in range(2 * rounds):
        watched = number % 2 == 1
        with pushed(rig) as (folder, cost):
            feed = Feed(rig, Aged())
            if watched:
                feed.attach(folder)
            share(feed, seconds / rounds)
        costs[watched] += cost
    with_feed, without = (statistics.median(costs[item]) for item in (True, False))
    noted(f"live {rig.name}: a push, no viewer", without, "ns")
    at_most(f"live {rig.name}: a push, with the feed", with_feed / without, 1.2)


def main() -> int:
    """Measure both rigs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    args = parser.parse_args()
    for name in RIGS:
        rig = load_rig(name)
        for measure in (alone, with_subscriber, with_foxglove, cost_to_the_cycle):
            measure(rig, args.seconds)
    return 0


if __name__ == "__main__":
    sys.exit(main())
