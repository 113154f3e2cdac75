"""What a daemon goes through in an hour, in rounds: connections, clients, floods, downloads."""

from __future__ import annotations

import json
import os
import socket
import time
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from support.daemon.process import Daemon, Refused
from support.daemon.served_rig import free_port
from support.daemon.zenoh_client import ZenohClient
from support.wire import ROOT

NAME = "lugre-1"
#: What is downloaded in each round: two pieces and a bit.
DOWNLOAD = "download.mcap"
DOWNLOAD_BYTES = 600_000
PIECE_BYTES = 256 * 1024
#: A crowded machine has closed what a round opened within this.
TIMEOUT_S = 60.0


@dataclass(frozen=True)
class Size:
    """What a process takes."""

    descriptors: int
    threads: int
    resident_kb: int

    @classmethod
    def of(cls, pid: int) -> Size:
        """Read it from the kernel."""
        process = Path(f"/proc/{pid}")
        status = dict(line.split(":", 1) for line in (process / "status").read_text().splitlines())
        return cls(
            len(list((process / "fd").iterdir())),
            int(status["Threads"]),
            int(status["VmRSS"].split()[0]),
        )


def soaked(folder: Path) -> Daemon:
    """Return a daemon of the shipped simulation, with something to download."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    rig = folder / "rig.yaml"
    text = (ROOT / "configs/sim_lugre.yaml").read_text()
    plant = ROOT / "configs/plants/lugre.yaml"
    rig.write_text(
        f"{text.replace('plants/lugre.yaml', str(plant))}\nremote: {{listen: [{endpoint}]}}\n"
    )
    state, runs = folder / "state", folder / "runs"
    state.mkdir(mode=0o700)
    runs.mkdir()
    daemon = Daemon(rig, NAME, endpoint, folder, state)
    daemon.notified("READY=1")
    (runs / DOWNLOAD).write_bytes(os.urandom(DOWNLOAD_BYTES))
    return daemon


def soak(daemon: Daemon, *, unauthenticated: int, clients: int, flood_s: float) -> None:
    """Do one round; it ends once only the daemon's own client is connected."""
    port = int(daemon.endpoint.rpartition(":")[2])
    with ExitStack() as connected:
        for number in range(unauthenticated):  # half of them silent
            found = connected.enter_context(socket.socket())
            found.setblocking(False)
            found.connect_ex(("127.0.0.1", port))
            with suppress(OSError):
                found.send(b"\x00" if number % 2 else b"")
        for _ in range(clients):
            with _client(daemon) as client:
                client.subscribe(f"rigd/{NAME}/*")
                client.alive("rigd/*/alive")
    spoilt = json.dumps({"v": 1}).encode()
    daemon.client.flood(f"rigd/{NAME}/ask/mallory/describe", spoilt, flood_s)
    for offset in range(0, DOWNLOAD_BYTES, PIECE_BYTES):
        daemon.request("ask", "fetch", run=DOWNLOAD, offset=offset, length=PIECE_BYTES)
    daemon.request("ask", "runs", limit=10)
    time.sleep(flood_s)


def _client(daemon: Daemon) -> ZenohClient:
    """Return another client; it tries again for some time, as the machine may be busy."""
    deadline = time.monotonic() + TIMEOUT_S
    while True:
        try:
            return daemon.connect()
        except Refused:
            if time.monotonic() > deadline:
                raise


def settled(daemon: Daemon, wanted: Size | None = None) -> Size:
    """Return what the daemon takes once it takes no more descriptors and threads than ``wanted``.

    Without, once that has not changed for two seconds.
    """
    deadline, since_s = time.monotonic() + TIMEOUT_S, time.monotonic()
    size = Size.of(daemon.process.pid)
    while time.monotonic() < deadline:
        time.sleep(0.1)
        before, size = size, Size.of(daemon.process.pid)
        if (size.descriptors, size.threads) != (before.descriptors, before.threads):
            since_s = time.monotonic()
        as_wanted = wanted is not None and (
            size.descriptors <= wanted.descriptors and size.threads <= wanted.threads
        )
        if as_wanted or (wanted is None and time.monotonic() - since_s > 2.0):
            break
    return size


def as_line(size: Size, round_: int, since_s: float) -> str:
    """Return a line of a file of slices."""
    return json.dumps({"round": round_, "s": round(since_s, 1), **asdict(size)})
