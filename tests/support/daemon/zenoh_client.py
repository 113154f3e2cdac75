"""A zenoh session in a process of its own, which does what a test commands, right or wrong.

It shares no code with rigd: it reads one JSON order per line and writes one JSON answer per line.
"""

from __future__ import annotations

import base64
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

#: A client that sends nothing for so long hangs.
TIMEOUT_S = 60


def config(
    endpoint: str, certificates: Path | None = None, name: str | None = None, ca: str = "ca.crt"
) -> dict[str, Any]:
    """The configuration of a client, written by hand; ``name`` is whose certificate it shows."""
    tls: dict[str, Any] = {}
    if certificates is not None:
        tls = {"root_ca_certificate": str(certificates / ca), "enable_mtls": name is not None}
        if name is not None:
            tls["connect_certificate"] = str(certificates / f"{name}.crt")
            tls["connect_private_key"] = str(certificates / f"{name}.key")
    return {
        "mode": "client",
        "connect": {"endpoints": [endpoint], "timeout_ms": 1500, "exit_on_failure": True},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"shared_memory": {"enabled": False}, "link": {"tls": tls}},
    }


class Refused(Exception):
    """The session could not be opened, or zenoh refused an order."""


class ZenohClient:
    """The process, and orders to it.

    ``niceness`` of 19 leaves the processor to others, as a client on another computer does.
    """

    def __init__(self, settings: dict[str, Any], niceness: int = 0) -> None:
        command = [sys.executable, __file__, json.dumps(settings)]
        self._process = subprocess.Popen(
            ["nice", "-n", str(niceness), *command] if niceness else command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": ""},
        )
        try:
            self._answer()
        except BaseException:
            self.kill()
            raise

    def get(self, key: str, payload: bytes = b"") -> list[dict[str, Any]]:
        """Query, and return all replies: ``ok``, ``payload`` and, if ok, ``key``."""
        replies = self._order(do="get", key=key, payload=base64.b64encode(payload).decode())
        return [reply | {"payload": base64.b64decode(reply["payload"])} for reply in replies]

    def ask(self, key: str, payload: bytes) -> Any:
        """Query, and return the one reply there must be, as JSON."""
        replies = self.get(key, payload)
        assert len(replies) == 1, replies
        return json.loads(replies[0]["payload"])

    def asking(self, key: str, payload: bytes) -> Callable[[], Any]:
        """Query in a thread; what is returned waits for the reply of :meth:`ask`."""
        came: list[Any] = []
        thread = threading.Thread(target=lambda: came.append(self.ask(key, payload)), daemon=True)
        thread.start()

        def reply() -> Any:
            thread.join(TIMEOUT_S)
            return came.pop()

        return reply

    def put(self, key: str, payload: bytes) -> None:
        """Publish."""
        self._order(do="put", key=key, payload=base64.b64encode(payload).decode())

    def subscribe(self, key: str) -> None:
        """Begin to count what comes on the keys that match."""
        self._order(do="subscribe", key=key)

    def answer_queries(self, key: str) -> None:
        """Answer queries on ``key`` with ``FAKE``."""
        self._order(do="answer", key=key)

    def pretend(self, key: str) -> None:
        """Declare a liveliness token."""
        self._order(do="pretend", key=key)

    def alive(self, key: str) -> list[str]:
        """Return the keys of the liveliness tokens there are."""
        return list(self._order(do="alive", key=key))

    def received(self, least: int = 0, within_s: float = 0.0) -> dict[str, int]:
        """Return how many samples came by key, after waiting for ``least`` of them."""
        return dict(self._order(do="received", least=least, within_s=within_s))

    def flood(self, key: str, payload: bytes, seconds: float, per_s: float = 0.0) -> None:
        """Query as fast as it goes, or ``per_s`` times a second, for some time.

        Returns once the first ten are sent.
        """
        self._order(
            do="flood",
            key=key,
            payload=base64.b64encode(payload).decode(),
            seconds=seconds,
            per_s=per_s,
        )

    def freeze(self) -> None:
        """Let the process stand still, as a computer that hangs."""
        self._process.send_signal(signal.SIGSTOP)

    def kill(self) -> None:
        """End it without a word."""
        self._process.kill()
        self._process.wait(TIMEOUT_S)
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def _order(self, **order: Any) -> Any:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()
        return self._answer()

    def _answer(self) -> Any:
        assert self._process.stdout is not None
        watchdog = threading.Timer(TIMEOUT_S, self._process.kill)
        watchdog.start()
        try:
            line = self._process.stdout.readline()
        finally:
            watchdog.cancel()
        assert line, "the client ended without an answer"
        answer = json.loads(line)
        if "refused" in answer:
            raise Refused(answer["refused"])
        return answer["result"]


class _Session:
    """The other side of the pipe."""

    def __init__(self, settings: str) -> None:
        import zenoh

        self._zenoh = zenoh
        self._session = zenoh.open(zenoh.Config.from_json5(settings))
        self._came = threading.Condition()
        self._count: Counter[str] = Counter()
        self._kept: list[Any] = []

    def get(self, key: str, payload: str) -> list[dict[str, Any]]:
        found = []
        for reply in self._session.get(key, payload=base64.b64decode(payload), timeout=10.0):
            ok = reply.ok is not None
            what = reply.ok.payload if reply.ok is not None else reply.err.payload  # type: ignore[union-attr]
            where = None if reply.ok is None else str(reply.ok.key_expr)
            content = base64.b64encode(what.to_bytes()).decode()
            found.append({"ok": ok, "key": where, "payload": content})
        return found

    def put(self, key: str, payload: str) -> None:
        self._session.put(key, base64.b64decode(payload))

    def subscribe(self, key: str) -> None:
        def came(sample: Any) -> None:
            with self._came:
                self._count[str(sample.key_expr)] += 1
                self._came.notify_all()

        self._kept.append(self._session.declare_subscriber(key, came))

    def answer(self, key: str) -> None:
        def fake(query: Any) -> None:
            with query:
                query.reply(query.key_expr, b"FAKE")

        self._kept.append(self._session.declare_queryable(key, fake))

    def pretend(self, key: str) -> None:
        self._kept.append(self._session.liveliness().declare_token(key))

    def alive(self, key: str) -> list[str]:
        replies = self._session.liveliness().get(key, timeout=10.0)
        return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]

    def received(self, least: int, within_s: float) -> dict[str, int]:
        with self._came:
            self._came.wait_for(lambda: self._count.total() >= least, within_s)
            return dict(self._count)

    def flood(self, key: str, payload: str, seconds: float, per_s: float) -> None:
        data = base64.b64decode(payload)
        begun_s = time.monotonic()

        def once() -> None:
            self._session.get(key, lambda reply: None, payload=data, timeout=1.0)

        def run() -> None:
            sent = 0
            while (passed_s := time.monotonic() - begun_s) < seconds:
                if per_s and sent >= passed_s * per_s:
                    time.sleep(0.002)
                    continue
                once()
                sent += 1

        for _ in range(10):
            once()
        threading.Thread(target=run, daemon=True).start()


def _main() -> None:
    def say(**answer: Any) -> None:
        print(json.dumps(answer), flush=True)  # noqa: T201 - the pipe to the test

    try:
        session = _Session(sys.argv[1])
    except Exception as error:  # noqa: BLE001 - reported to the test
        say(refused=repr(error))
        return
    say(result=None)
    for line in sys.stdin:
        order: dict[str, Any] = json.loads(line)
        do: Callable[..., Any] = getattr(session, order.pop("do"))
        try:
            say(result=do(**order))
        except Exception as error:  # noqa: BLE001 - reported to the test
            say(refused=repr(error))


if __name__ == "__main__":
    _main()
    sys.stdout.flush()
    os._exit(0)  # callback threads of zenoh would keep the process
