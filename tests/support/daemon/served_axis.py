"""The service of a rig of one axis, without a network: what a server would ask of it, asked."""

from __future__ import annotations

import hashlib
import json
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

from support.daemon import file_axis

from rigd.config.rig import RigConfig
from rigd.daemon.live import Feed
from rigd.daemon.serve.compared_pages import ComparedPages
from rigd.daemon.serve.handlers import Parts
from rigd.daemon.serve.idle_rig import IdleRig
from rigd.daemon.serve.library import Library
from rigd.daemon.serve.recordings import Recordings
from rigd.daemon.serve.service import RigService
from rigd.daemon.serve.steering import Steering
from rigd.daemon.serve.upkeep.audit import AuditLog
from rigd.daemon.serve.upkeep.certificates import CertificateWatch
from rigd.daemon.serve.upkeep.notices import Notices
from rigd.daemon.serve.upkeep.recovery import Interruptions
from rigd.daemon.serve.upkeep.trips import TripMemory
from rigd.daemon.serve.worker import CalculationWorker
from rigd.engine.run import run
from rigd.engine.shared import RunFolder
from rigd.remote.protocol import (
    Kind,
    Requester,
    RigEvent,
    Role,
    Status,
    Verb,
    as_json,
    encode,
    find_verb,
)
from rigd.remote.protocol.status import RefusedCounts
from rigd.remote.server import Lease

#: A crowded machine does everything within this.
TIMEOUT_S = 60.0
#: Slow enough for a crowded machine to miss next to no cycle.
PERIOD_NS = 20_000_000

#: One trial per speed; a step of each moves the axis for a while.
SWEEP = """\
procedure: sweep
title: Moves an axis
doc: For tests.
parameters:
  speed: {doc: Speed, unit: m/s}
  time: {doc: How long, unit: s, default: 0.3 s}
sweep: {grid: {speed: [0.1 m/s, 0.2 m/s, 0.3 m/s]}}
trial:
  steps:
    - step: go
      set: {axis.speed: "${speed}"}
      for: ${time}
finish:
  - step: home
    set: {axis.speed: 0 m/s}
    for: 0.1 s
"""
#: Lasts until something ends it.
LONG = SWEEP.replace("default: 0.3 s", "default: 30 s")

#: Asks for a load in each trial.
ASKING = """\
procedure: asking
title: Asks, then moves
doc: For tests.
sweep: {grid: {load: [1 kg, 2 kg]}}
parameters:
  load: {doc: Load, unit: kg}
trial:
  steps:
    - prompt: put_load
      text: Put ${load} on the platform.
      unit: kg
      min: 0 kg
      max: 5 kg
      answer: ${load}
    - step: go
      set: {axis.speed: 0.1 m/s}
      for: 0.2 s
"""


@dataclass
class Outlet:
    """Keeps what is shown."""

    events: list[RigEvent] = field(default_factory=list)
    frames: int = 0

    def frame(self, stream: str, payload: bytes) -> None:
        self.frames += 1

    def event(self, event: RigEvent) -> None:
        self.events.append(event)


@dataclass
class Clock:
    """Monotonic ns that stand until they are moved: on a slow machine no lease runs out."""

    ahead_ns: int = 0

    def __call__(self) -> int:
        return self.ahead_ns


class ServedAxis:
    """A service on a rig of one axis, whose runs are real processes; used as a context."""

    def __init__(self, folder: Path, rig: RigConfig | None = None, **options: Any) -> None:
        self.runs = folder / "runs"
        self.runs.mkdir(exist_ok=True)
        self.axis = folder / "axis"
        # A host that stalls for a second would end a run.
        patient = {"cycle_silence_s": 10.0, "daemon_silence_s": 20.0} | options
        axis = file_axis.rig(self.axis, **patient)
        self.rig = rig or replace(axis, period_ns=PERIOD_NS)
        self.clock = Clock()
        self.outlet = Outlet()
        self.notifications = threading.Event()
        self.folder = RunFolder.take(self.rig.name, command="test")
        self.lease = Lease(clock=self.clock)
        self.feed = Feed(self.rig, self.outlet)
        self.notices = Notices(self.notifications.set)
        self.recordings = Recordings(self.runs)
        self.trips = TripMemory(self.runs / "trips.json")
        self.interruptions = Interruptions(self.rig.name, self.recordings, self.notices)
        self.interruptions.recover(self.folder, self.trips)
        library = Library(self.rig, folder / "procedures")
        self.audit = AuditLog(self.runs / "audit.jsonl")
        self.steering = Steering(
            self.rig,
            self.folder,
            self.runs,
            library=library,
            lease=self.lease,
            feed=self.feed,
            trips=self.trips,
            notices=self.notices,
            looks=IdleRig(
                self.rig, self.folder, self.feed, monitored=False, notify=self.notices.note
            ),
            changed=self.notifications.set,
            ended=lambda last: self.interruptions.ended(last.run),
            settle=lambda: self.interruptions.settle(self.folder),
        )
        self.service = RigService(
            Parts(
                self.rig,
                self.lease,
                self.feed,
                self.steering,
                self.recordings,
                library,
                self.interruptions,
                self.trips,
                self.notices,
                self.audit,
                CalculationWorker(),
                CalculationWorker(),
                ComparedPages(CalculationWorker()),
                CertificateWatch(self.rig.remote, self.notices.note),
            ),
            RefusedCounts,
            self.notifications.set,
        )

    def __enter__(self) -> ServedAxis:
        # Of 60 cycles a host that stalls for 0.1 s keeps more than a run may miss.
        self._missed = patch.object(run, "MISSED_SHARE", 0.5)
        self._missed.start()
        self.feed.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.steering.leave("the test is over")
        self.steering.leave("the test is over")
        self.steering.close()
        self.feed.stop()
        self.folder.release()
        self._missed.stop()

    @property
    def status(self) -> Status:
        """The status, as a client reads it."""
        return Status.model_validate_json(encode(self.service.status()))

    def ask(self, what: str, role: Role = Role.OBSERVER, **args: Any) -> Any:
        """Ask, and return the answer as JSON has it."""
        return self._answer(find_verb(Kind.ASK, what), Requester("eve", role=role), args)

    def command(self, verb: str, who: str = "alice", user: str = "", **args: Any) -> Any:
        """Command as the desk would, and return the answer as JSON has it."""
        known = find_verb(Kind.COMMAND, verb)
        requester = Requester(who, user, Role.MAINTAINER, self.service.stops)
        if known.rule.needs_lease:
            self.lease.check(requester.client)
        return self._answer(known, requester, args)

    def stop(self, who: str, verb: str, reason: str = "", user: str = "") -> bool:
        """Stop, and return whether there was something to stop."""
        known = find_verb(Kind.STOP, verb)
        acted: bool = self._answer(known, Requester(who, user), {"reason": reason})["acted"]
        return acted

    def _answer(self, verb: Verb, requester: Requester, args: Mapping[str, Any]) -> Any:
        given = verb.arguments.model_validate_json(json.dumps(args))
        return as_json(self.service.answer(verb, requester, given))

    def start(self, text: str = SWEEP, who: str = "alice", **args: Any) -> str:
        """Take the lease and start a run; return the name of its recording."""
        self.command("lease_take", who)
        name: str = self.command("start", who, procedure=travelling(text), **args)["run"]
        return name

    def until(self, condition: Callable[[Status], object]) -> Status:
        """Wait until the status is so, as the daemon's main loop would."""
        deadline = time.monotonic() + TIMEOUT_S
        while not condition(status := self.status):
            assert time.monotonic() < deadline, status
            self.service.tend()
            self.notifications.wait(0.05)
            self.notifications.clear()
        return status

    def until_idle(self) -> Status:
        """Wait for the end of the run."""
        return self.until(lambda status: status.state == "idle")

    def audited(self) -> list[dict[str, Any]]:
        """The audit log."""
        return [json.loads(line) for line in self.audit.path.read_text().splitlines()]


def travelling(text: str) -> Mapping[str, str]:
    """Return a procedure as it travels."""
    name = text.partition("\n")[0].removeprefix("procedure: ")
    return {"name": name, "text": text, "sha256": hashlib.sha256(text.encode()).hexdigest()}
