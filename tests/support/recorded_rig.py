"""A rig behind a server that only notes what it was asked to do."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from rigd.remote.protocol import VERSION, Message, Role, Status
from rigd.remote.protocol.arguments import NoArguments
from rigd.remote.protocol.status import Daemon
from rigd.remote.server import Lease, Result


@dataclass
class RecordedRig:
    """Notes every command and stop as ``(identity, verb)``, in the order they came."""

    name: str
    lease: Lease
    done: list[tuple[str, str]] = field(default_factory=list)
    said: int = 0
    fails: str = ""  #: the verb that raises ``error``
    error: Exception = field(default_factory=lambda: RuntimeError("a bug of the rig's own"))
    hangs: str = ""  #: the verb that returns only once it is ``let_go``
    begun: threading.Event = field(default_factory=threading.Event)  #: it hangs
    let_go: threading.Event = field(default_factory=threading.Event)
    huge: int = 0  #: characters that each reply to a question has too many
    computes_s: float = 0.0  #: processor time that each reply to a question takes

    def hold_lease(self, identity: str) -> None:
        """Give the lease to ``identity``, whoever has it."""
        self.lease.obey(identity, "lease_seize", NoArguments())

    @contextmanager
    def hanging(self, verb: str) -> Iterator[None]:
        """Let ``verb`` hang while inside, or until it is ``let_go``."""
        self.begun.clear()
        self.let_go.clear()
        self.hangs = verb
        try:
            yield
        finally:
            self.hangs = ""
            self.let_go.set()

    def status(self) -> Status:
        """Return a status that counts itself."""
        self.said += 1
        return Status(
            v=VERSION,
            rig=self.name,
            title="A rig that only notes",
            t_ns=time.time_ns(),
            seq=self.said,
            daemon=Daemon(version="0", pid=1, started_ns=0),
            state="idle",
            lease=self.lease.view(),
        )

    def ask(self, identity: str, role: Role, what: str, args: Message) -> Result:
        """Say who asked, after a calculation."""
        self._fail(what)
        end_s = time.thread_time() + self.computes_s
        while time.thread_time() < end_s:
            pass
        return {"by": identity, "role": role.value, "huge": "x" * self.huge}

    def command(self, identity: str, role: Role, verb: str, args: Message, user: str) -> Result:
        """Note it; what concerns the lease is done."""
        self.done.append((identity, verb))
        self._fail(verb)
        return self.lease.obey(identity, verb, args) if verb.startswith("lease_") else {}

    def stop(self, identity: str, verb: str, reason: str, user: str) -> Result:
        """Note it."""
        self.done.append((identity, verb))
        self._fail(verb)
        return {"reason": reason}

    def _fail(self, verb: str) -> None:
        if verb == self.hangs:
            self.begun.set()
            assert self.let_go.wait(60)
        if verb == self.fails:
            raise self.error
