"""`rigd serve` as a user and a service manager meet it: a process, spoken to over the network."""

from __future__ import annotations

import json
import os
import secrets
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from support.daemon.served_axis import travelling
from support.daemon.zenoh_client import Refused, ZenohClient, config
from support.recordings.blocks import alive
from support.wire import ROOT

from rigd.engine.shared import RunFolder, Word

#: A crowded machine does everything within this.
TIMEOUT_S = 90.0


def listening(rig: Path, port: int) -> str:
    """Let the rig of a file be served on ``port``; return the endpoint."""
    endpoint = f"tcp/127.0.0.1:{port}"
    rig.write_text(f"{rig.read_text()}\nremote: {{listen: [{endpoint}]}}\n")
    return endpoint


class Daemon:
    """The daemon of the rig ``name``, described by ``rig``, with a client that has a process too.

    ``state`` is where its rings stand, ``certificates`` whence its client alice has hers, and
    ``descriptors`` how many it may have.
    """

    def __init__(
        self,
        rig: Path,
        name: str,
        endpoint: str,
        folder: Path,
        state: Path,
        *,
        certificates: Path | None = None,
        descriptors: int | None = None,
    ) -> None:
        self.name, self.endpoint = name, endpoint
        self._certificates = certificates
        self.runs, self.state = folder / "runs", state
        folder.mkdir(exist_ok=True)
        self._told = folder / f"serve-{time.monotonic_ns()}.log"
        self._notify = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        address = f"rigd-test-{os.getpid()}-{time.monotonic_ns()}"
        self._notify.bind(f"\0{address}")
        self._news = threading.Condition()
        self._notified: list[str] = []
        threading.Thread(target=self._listen, daemon=True).start()
        with self._told.open("wb") as log:
            self.process = subprocess.Popen(
                [
                    *([] if descriptors is None else ["prlimit", f"--nofile={descriptors}"]),
                    *(sys.executable, "-m", "rigd", "serve", "--rig", str(rig), "--no-panel"),
                    *("--runs", str(self.runs)),
                ],
                cwd=ROOT,
                env={
                    **os.environ,
                    "RIGD_STATE": str(state),
                    "NOTIFY_SOCKET": f"@{address}",
                },
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        self._client: ZenohClient | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._client is not None:
            self._client.kill()
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(TIMEOUT_S)
        self._notify.shutdown(socket.SHUT_RDWR)
        self._notify.close()

    @property
    def told(self) -> str:
        """What it has printed."""
        return self._told.read_text()

    def notified(self, text: str, times: int = 1) -> None:
        """Wait until the service manager gets ``text``, so many ``times`` from the start on."""
        deadline = time.monotonic() + TIMEOUT_S
        with self._news:
            while sum(text in item for item in self._notified) < times:
                assert time.monotonic() < deadline, self.told
                assert self.process.poll() in (None, 0), self.told
                self._news.wait(0.2)

    def _listen(self) -> None:
        """Take what the service manager gets, until the socket is closed."""
        while message := self._notify.recv(1000):
            with self._news:
                self._notified.append(message.decode())
                self._news.notify_all()

    @property
    def client(self) -> ZenohClient:
        """A client in a process of its own."""
        if self._client is None:
            self._client = self.connect()
        return self._client

    def connect(self) -> ZenohClient:
        """Return another client, in a process of its own."""
        name = None if self._certificates is None else "alice"
        return ZenohClient(config(self.endpoint, self._certificates, name))

    def kill_client(self) -> None:
        """The client vanishes without a word."""
        self.client.kill()
        self._client = None

    def request(self, kind: str, verb: str, who: str = "alice", **args: Any) -> Any:
        """Ask, command or stop; return the result."""
        message = {
            "v": 1,
            "id": secrets.token_hex(16),
            "sent_ns": time.time_ns(),
            "args": args,
        }
        key = f"rigd/{self.name}/{kind}/{who}/{verb}"
        reply = self.client.ask(key, json.dumps(message).encode())
        assert "result" in reply, reply
        return reply["result"]

    def start(self, text: str, **args: Any) -> Path:
        """Take the lease and start a run; return its recording."""
        self.request("cmd", "lease_take")
        run: str = self.request("cmd", "start", procedure=travelling(text), **args)["run"]
        return self.runs / run

    @property
    def status(self) -> dict[str, Any]:
        """The newest status."""
        (reply,) = self.client.get(f"rigd/{self.name}/status")
        status: dict[str, Any] = json.loads(reply["payload"])
        return status

    def until(
        self, condition: Callable[[dict[str, Any]], object], *, steered: bool = True
    ) -> dict[str, Any]:
        """Wait until the status is so; ``steered``: renew the lease meanwhile, as a client does."""
        deadline, renewed = time.monotonic() + TIMEOUT_S, 0.0
        while not condition(status := self.status):
            assert time.monotonic() < deadline, (status, self.told)
            if steered and time.monotonic() > renewed + 1.0:
                self.request("cmd", "lease_renew")
                renewed = time.monotonic()
            time.sleep(0.05)
        return status

    @property
    def folder(self) -> RunFolder:
        """The folder of the run under way."""
        (path,) = (item for item in self.state.iterdir() if RunFolder.at(item).has_job)
        return RunFolder.at(path)

    def pids(self) -> list[int]:
        """The processes of the run under way."""
        board = self.folder.board()
        return [self.process.pid, board[Word.PID_CYCLE], board[Word.PID_RECORDER]]

    def now_ns(self) -> int:
        """Unix time now, by the clock of the run under way: that of its rows."""
        board = self.folder.board()
        return board[Word.START_NS] - board[Word.ORIGIN_NS] + time.monotonic_ns()

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        self.process.send_signal(number)

    def ended(self) -> int:
        """Wait for its end, and return its exit code."""
        return self.process.wait(TIMEOUT_S)


def until_gone(pids: list[int]) -> None:
    """Wait until none of the processes is left."""
    deadline = time.monotonic() + TIMEOUT_S
    while any(map(alive, pids)):
        assert time.monotonic() < deadline
        time.sleep(0.02)


__all__ = ["Daemon", "Refused", "listening", "until_gone"]
