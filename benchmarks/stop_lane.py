"""How soon a request is answered that has a lane of its own, as stops have, while others flood.

A daemon with a run under way, ten watchers of all its streams and a client that floods, against
itself before those came. Beside it a witness that meets the same load: a process with a bare
queryable of zenoh that replies at once. Turns are interleaved, so that what else the machine does
meets all. Renewals of the lease stand for stops: they go the same way, each by a lane of its own,
and end no run. Last, what `rigd remote stop` costs from its launch to its end, in processor time,
which others on the machine change little.

    python benchmarks/stop_lane.py --rounds 5
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.synchronize import Event
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import numpy as np
import zenoh
from crowd import crowded, message
from figures import at_most, noted
from support.daemon.process import Daemon
from support.daemon.served_rig import free_port, serve
from support.daemon.zenoh_client import config
from support.faults.soaking import NAME, soaked
from support.panel.played_rig import RUN

REQUESTS = 100
#: A stop leaves the shell within this, in ms of processor time.
MOST_MS = 150.0
SHAKE = """\
procedure: shake
title: Moves
doc: For the bench.
trial:
  steps:
    - step: shake
      set: {wheel_servo.current: {sine: {amplitude: 0.3 A, frequency: 2 Hz}}}
      for: 1 h
"""


def witness(endpoint: str, ready: Event, end: Event) -> None:
    """Reply at once to any query."""
    settings = {
        "mode": "peer",
        "listen": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
    }
    session = zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))

    def reply(query: zenoh.Query) -> None:
        with query:
            query.reply("bench/witness", b"ok")

    session.declare_queryable("bench/witness", zenoh.handlers.Callback(reply, indirect=False))
    ready.set()
    end.wait()
    session.close()


@contextmanager
def witnessed() -> Iterator[str]:
    """Yield the endpoint of a witness in a process of its own."""
    spawning = multiprocessing.get_context("spawn")
    ready, end = spawning.Event(), spawning.Event()
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    process = spawning.Process(target=witness, args=(endpoint, ready, end))
    process.start()
    ready.wait()
    try:
        yield endpoint
    finally:
        end.set()
        process.join()


def opened(endpoint: str) -> zenoh.Session:
    """Return a session of this process."""
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config(endpoint))))


def taken_ms(session: zenoh.Session, key: str, payload: Callable[[], bytes]) -> list[float]:
    """Return how long each of some requests took to its reply, ms: a refusal is one too."""
    took = []
    for _ in range(REQUESTS):
        begun = time.perf_counter()
        replies = list(session.get(key, payload=payload(), timeout=5.0))
        took.append((time.perf_counter() - begun) * 1e3 if replies else np.inf)
        time.sleep(0.005)
    return took


def measured(daemon: Daemon, witness_at: str, rounds: int) -> dict[str, list[float]]:
    """Return the times of daemon and witness, quiet and loaded."""
    found: dict[str, list[float]] = {}
    ours, theirs = opened(daemon.endpoint), opened(witness_at)
    key = f"rigd/{NAME}/cmd/alice/lease_renew"

    def turn(name: str) -> None:
        found.setdefault(f"daemon {name}", []).extend(taken_ms(ours, key, message))
        found.setdefault(f"witness {name}", []).extend(
            taken_ms(theirs, "bench/witness", lambda: b"")
        )

    for _ in range(rounds):
        turn("quiet")
        with crowded(daemon.endpoint, NAME):
            turn("loaded")
    ours.close()
    theirs.close()
    return found


def from_shell_ms(verb: str, count: int) -> list[float]:
    """Return the processor time of each of some commands that stop a run, ms."""
    found = []
    words = [sys.executable, "-m", "rigd", "remote", verb, "--as", "ann"]
    with serve() as remote:
        for _ in range(count + 1):
            remote.rig.state, remote.rig.run = "running", RUN
            begun = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run([*words, "--endpoint", remote.endpoint], check=True, capture_output=True)
            ended = resource.getrusage(resource.RUSAGE_CHILDREN)
            found.append(1e3 * (ended.ru_utime - begun.ru_utime + ended.ru_stime - begun.ru_stime))
    return found[1:]  # the first may compile modules


def main() -> None:
    """Measure, and print quantiles and ratios."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    with (
        witnessed() as witness_at,
        tempfile.TemporaryDirectory() as folder,
        soaked(Path(folder)) as daemon,
    ):
        daemon.start(SHAKE, on_client_loss="continue")
        daemon.until(lambda status: status["step"] == "shake")
        found = measured(daemon, witness_at, args.rounds)
    for verb in ("stop", "abort", "estop"):
        took = from_shell_ms(verb, 4 * args.rounds)
        at_most(f"rigd remote {verb}, processor time, p50", float(np.median(took)), MOST_MS, "ms")
    for name, took in found.items():
        for part in (50, 99):
            noted(f"reply of the {name}, p{part}", float(np.percentile(took, part)), "ms")
    for which, report in (("daemon", at_most), ("witness", None)):
        quiet, loaded = (
            np.percentile(found[f"{which} {item}"], 99) for item in ("quiet", "loaded")
        )
        name = f"reply of the {which}, p99, loaded against quiet"
        if report is None:
            noted(name, float(loaded / quiet), "x")
        else:
            report(name, float(loaded / quiet), 3.0)


if __name__ == "__main__":
    main()
