"""Random and spoilt payloads on every key of a rig that is served: what they change, and cost.

10,000 for each verb, eight at a time, and as many publications on the keys that only the daemon
may publish on. Nothing may be carried out, the server must answer every good request in between,
and its memory must not grow. Then what a flood costs another client: the time from asking to the
reply, for stops, beside a client that floods and without it, interleaved.

    python benchmarks/remote_fuzz.py --payloads 10000
"""

from __future__ import annotations

import argparse
import json
import os
import random
import statistics
import sys
import threading
import time
from collections import Counter
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import zenoh
from figures import at_most, noted
from support.daemon.served_rig import RIG, free_port, key, request, serve
from support.daemon.zenoh_client import ZenohClient, config
from support.faults.spoilt import spoilt_payloads

from rigd.config.remote import RemoteSetup
from rigd.remote.network import client_config
from rigd.remote.protocol import VERBS, Kind

#: Requests under way at once: as many as one identity may have waiting.
AT_ONCE = 8
#: What only the daemon publishes on.
#: A loaded machine takes its time to begin and to end, in s.
PATIENCE_S = 300
PUBLISHED = ("status", "event", "live/wheel", "alive")


def serve_until_told(endpoint: str, pipe: Connection) -> None:
    """Serve a rig; at each word through the pipe send what was done, and the memory taken."""
    with serve(RemoteSetup((endpoint,), roles={"eve": "maintainer"})) as served:
        served.rig.hold_lease("eve")
        while True:
            pipe.send((list(served.rig.done), resident_mb(), served.server.refused().model_dump()))
            if pipe.recv() == "end":
                return


def resident_mb() -> float:
    """Return the memory this process takes, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


class Asked:
    """Sends requests, up to eight at once, and counts the replies by their content."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session
        self.free = threading.Semaphore(AT_ONCE)
        self.codes: Counter[str] = Counter()

    def send(self, where: str, payload: bytes) -> None:
        """Send one as soon as there is room."""
        self.free.acquire()
        replies: list[str] = []

        def came(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                replies.append("ok")
            elif reply.err is not None:
                replies.append(json.loads(reply.err.payload.to_bytes())["error"]["code"])

        def ended() -> None:
            self.codes.update(replies or ["no reply"])
            self.free.release()

        handler = zenoh.handlers.Callback(came, ended)
        self.session.get(where, handler, payload=payload, timeout=30.0)

    def wait(self) -> None:
        """Wait until all have come back."""
        for _ in range(AT_ONCE):
            self.free.acquire()
        for _ in range(AT_ONCE):
            self.free.release()


def fuzz(session: zenoh.Session, pipe: Connection, payloads: int) -> None:
    """Send everything, and report what became of it."""
    rng = random.Random()
    asked, sizes = Asked(session), []
    done, _, _ = pipe.recv()
    before_s = time.monotonic()
    for kind in (Kind.ASK, Kind.COMMAND):  # a stop is carried out with any content
        for verb in VERBS[kind]:
            for number, payload in enumerate(spoilt_payloads(rng, request(verb), payloads)):
                asked.send(key(kind.value, "eve", verb), payload)
                if number % 1000 == 999:
                    asked.send(key("ask", "eve", "latest"), request("latest"))
            asked.wait()
            sizes.append(memory(pipe))
    for where in PUBLISHED:
        for payload in spoilt_payloads(rng, request("stop"), payloads):
            session.put(f"rigd/{RIG}/{where}", payload)
        sizes.append(memory(pipe))
    took_s = time.monotonic() - before_s
    pipe.send("report")
    after, size_mb, refused = pipe.recv()
    pipe.send("report")
    good = len(VERBS[Kind.ASK]) + len(VERBS[Kind.COMMAND])
    good *= payloads // 1000
    print(f"replies: {dict(asked.codes)}\ncounted: {refused}")
    noted("remote: spoilt payloads sent", sum(asked.codes.values()) - good, "")
    noted("remote: sent per second", sum(asked.codes.values()) / took_s, "/s")
    at_most("remote: of them carried out", asked.codes["ok"] - good, 0, "")
    at_most("remote: commands and stops done by them", len(after) - len(done), 0, "")
    at_most("remote: without a reply", asked.codes["no reply"], 0, "")
    settled_mb = statistics.median(sizes[: len(sizes) // 4])
    noted("remote: memory of the server", size_mb, "MB")
    at_most("remote: its growth over the last three quarters", size_mb - settled_mb, 5, "MB")


def memory(pipe: Connection) -> float:
    """Return the memory that the server takes now, MB."""
    pipe.send("report")
    return float(pipe.recv()[1])


def flooded(session: zenoh.Session, endpoint: str, rounds: int) -> None:
    """Time stops beside a flood and without it, in turn."""
    times: dict[bool, list[float]] = {True: [], False: []}
    with ZenohClient(config(endpoint)) as flooding:
        for _ in range(rounds):
            for flood in (False, True):
                if flood:
                    flooding.flood(key("ask", "mallory", "latest"), request("latest"), 1.0)
                    flooding.flood(key("cmd", "mallory", "pause"), b"{", 1.0)
                end_s = time.monotonic() + 1.0
                while time.monotonic() < end_s:
                    begun_s = time.perf_counter()
                    replies = list(session.get(key("stop", "eve", "stop"),
                                               payload=request("stop"), timeout=10.0))  # fmt: skip
                    if [reply.ok is not None for reply in replies] != [True]:
                        raise RuntimeError(f"a stop was not answered: {replies}")
                    times[flood].append(1e3 * (time.perf_counter() - begun_s))
                    time.sleep(0.01)
                time.sleep(0.5)
    for flood, words in ((False, ""), (True, ", beside a flood")):
        p50, p99 = (statistics.quantiles(times[flood], n=100)[index] for index in (49, 98))
        noted(f"remote: stop to its reply{words}, p50", p50, "ms")
        noted(f"remote: stop to its reply{words}, p99", p99, "ms")


def main() -> None:
    """Serve in a process of its own, and do it all."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--payloads", type=int, default=10_000, help="for each key")
    parser.add_argument("--rounds", type=int, default=10, help="of two seconds, for the flood")
    args = parser.parse_args()
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    context = get_context("spawn")
    pipe, theirs = context.Pipe()
    server = context.Process(target=serve_until_told, args=(endpoint, theirs))
    server.start()
    try:
        if not pipe.poll(PATIENCE_S):
            raise RuntimeError("the server did not begin")
        with zenoh.open(client_config([endpoint])) as session:
            fuzz(session, pipe, args.payloads)
            flooded(session, endpoint, args.rounds)
        if pipe.poll(PATIENCE_S):
            pipe.recv()
        pipe.send("end")
        server.join(PATIENCE_S)
        at_most("remote: exit code of the server", abs(server.exitcode or 0), 0, "")
    finally:
        server.kill()


if __name__ == "__main__":
    main()
