"""Carries out the requests of clients on one rig (:class:`rigd.remote.server.Service`)."""

from __future__ import annotations

import itertools
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

from rigd import __version__
from rigd.daemon.provenance import trial_label
from rigd.daemon.serve.handlers import Parts, bind_handlers
from rigd.daemon.serve.running import Running, loss_of
from rigd.daemon.serve.upkeep.descriptors import counts
from rigd.daemon.waiting import what_waits
from rigd.model.errors import ConfigError, RigdError
from rigd.procedure.program import CompiledProcedure, TrialPlan
from rigd.remote.protocol import (
    VERSION,
    Code,
    Kind,
    Lane,
    Message,
    Refusal,
    Requester,
    Status,
    Verb,
    as_json,
)
from rigd.remote.protocol.arguments import Checked
from rigd.remote.protocol.results import Stopped
from rigd.remote.protocol.status import Daemon, RefusedCounts, TrialStatus


class RigService:
    """Serves one rig; every method may be called from any thread.

    ``refused`` returns how many messages the server has refused, ``changed`` is called when the
    status has changed, ``crowding`` returns what it did about unauthenticated connections.
    """

    def __init__(
        self,
        parts: Parts,
        refused: Callable[[], RefusedCounts],
        changed: Callable[[], None],
        crowding: Callable[[], dict[str, int]] = dict,
    ) -> None:
        self._parts = parts
        self._handlers = bind_handlers(parts)
        self._refused = refused
        self._changed = changed
        self._numbers = itertools.count()
        self._unwritten: deque[Callable[[], None]] = deque()  # write a line of the audit log each
        self._writing = threading.Lock()
        self._broken = ""  # why the audit log could not be written when it was last looked at
        self._daemon = Daemon(version=__version__, pid=os.getpid(), started_ns=time.time_ns())
        self._crowding = crowding
        self._crowded = crowding()  # as it stands in the audit log

    def status(self) -> Status:
        """Return the state of everything."""
        parts, running = self._parts, self._parts.steering.running
        return Status(
            v=VERSION,
            rig=parts.rig.name,
            title=parts.rig.title,
            t_ns=time.time_ns(),
            rows_ns=parts.feed.t_ns,
            seq=next(self._numbers),
            daemon=self._daemon.model_copy(update={**counts(), **self._crowding()}),
            **({"state": "idle"} if running is None else _progress(running)),
            lease=parts.lease.view(),
            trips=parts.trips.views(),
            interrupted=tuple(
                view for view in parts.interruptions.views() if view.run != parts.under_way
            ),
            last=parts.steering.last,
            refused=self._refused(),
            notices=parts.notices.views(),
            certificates=parts.certificates.views(),
        )

    @property
    def stops(self) -> int:
        """How many stops were carried out."""
        return self._parts.steering.stops

    @property
    def doing(self) -> str:
        """The present activity, in a few words."""
        running = self._parts.steering.running
        if running is None:
            return "idle"
        progress = running.progress
        return (
            f"{running.request.procedure.name}: {progress.state.name.lower()}, "
            f"{progress.trials_done} of {progress.trials_total} trials"
        )

    def answer(self, verb: Verb, requester: Requester, args: Message) -> Message:
        """Carry out a verb; a verb that changes something is logged with its requester.

        :meth:`tend` logs stops and what changes the lease: a disk that hangs must delay no estop
        after a stop, and no renewal of the lease.
        """
        self._parts.certificates.seen(requester.identity, requester.certificate_until_ns)
        if verb.rule.kind is Kind.COMMAND:
            return self._command(verb, requester, args)
        result = verb.carry_out(self._handlers, requester, args)
        if result == Stopped(acted=True):  # a repeated stop changes nothing and is not logged
            self._write(verb, requester, args, "done")
        return result

    def _command(self, verb: Verb, requester: Requester, args: Message) -> Message:
        try:
            if verb.rule.moves:
                self._parts.recordings.make_folder()
                self._parts.audit.check()
            result = verb.carry_out(self._handlers, requester, args)
        except Refusal as refusal:
            self._write(verb, requester, args, f"{refusal.code.value}: {refusal.message}")
            raise
        except RigdError as error:
            self._write(verb, requester, args, f"refused: {error}")
            raise _refusal(error) from error
        except Exception as error:
            self._write(verb, requester, args, f"internal: {error!r}")
            raise
        self._write(verb, requester, args, "done")
        self._changed()
        return result

    def tend(self) -> None:
        """Do periodic work: act on an expired lease, then audit what waits."""
        audit = self._parts.audit
        self._parts.certificates.tend()
        for holder in self._parts.lease.lost():
            done = self._parts.steering.client_lost(holder)
            expired = self._parts.certificates.expired(holder.identity)
            why = f" ({expired})" if expired else ""
            self._parts.notices.note(f"{loss_of(holder)}{why}: {done}", "warning")
            self._unwritten.append(
                partial(audit.write, holder.identity, "lease_lost", {}, done, user=holder.user)
            )
        self._write_all()
        broken, self._broken = self._broken, audit.broken
        if self._broken and not broken:
            self._parts.notices.note(f"nothing can start: {self._broken}", "error")
        if (crowding := self._crowding()) != self._crowded:
            self._crowded = crowding
            audit.write("rigd", "unauthenticated", crowding)
            self._parts.notices.note(
                "too many unauthenticated connections: for a while no other is accepted", "warning"
            )
        self._parts.steering.tend()

    def _write(self, verb: Verb, requester: Requester, args: Message, result: str) -> None:
        """Have a command written to the audit log; those of some lanes do not wait for it."""
        if not verb.rule.audited:
            return
        self._unwritten.append(partial(self._write_line, verb, requester, args, result))
        if verb.rule.lane not in (Lane.STOP, Lane.LEASE):
            self._write_all()

    def _write_all(self) -> None:
        with self._writing:
            while self._unwritten:
                self._unwritten.popleft()()

    def _write_line(self, verb: Verb, requester: Requester, args: Message, result: str) -> None:
        """Write a command to the audit log, and report it to the clients that watch."""
        audited = _audited(args)
        self._parts.audit.write(
            requester.identity,
            verb.name,
            audited,
            result,
            role=requester.role.value,
            user=requester.user,
        )
        if result == "done":
            command = {"who": str(requester), "verb": verb.name, "args": audited}
            self._parts.feed.publish("command", command)


def _progress(running: Running) -> dict[str, Any]:
    """Return the progress of a run for the status."""
    progress, request = running.progress, running.request
    trial, answers = progress.trial, running.answers
    return {
        "state": progress.state.name.lower(),
        "procedure": request.procedure.name,
        "run": running.recording.name,
        "step": progress.step or None,
        "can_hold": progress.step in running.can_be_held,
        "trial": None if trial is None else _trial(trial, request.procedure),
        "trials_done": progress.trials_done,
        "trials_total": progress.trials_total,
        "run_s": max(progress.run_s, 0.0),
        "left_s": running.left.left_s(progress),
        "pause_in_s": running.left.until_pause_s(progress, request.procedure),
        "waits": what_waits(progress, request),
        "ending": progress.ending,
        "coming_to_rest": progress.coming_to_rest,
        "prompt": None if answers is None else answers.view(),
    }


def _trial(trial: TrialPlan, procedure: CompiledProcedure) -> TrialStatus:
    return TrialStatus(
        number=trial.number,
        repeat=trial.repeat,
        parameters=dict(trial.parameters),
        units={k: unit for k, unit in procedure.units.items() if k in trial.parameters},
        label=trial_label(trial, procedure),
    )


def _refusal(error: RigdError) -> Refusal:
    """Return the refusal for a client; for a file, with every problem."""
    if isinstance(error, ConfigError):
        return Refusal(Code.WRONG, str(error))
    return Refusal(Code.REFUSED, error.message, hint=error.hint)


def _audited(args: Message) -> dict[str, Any]:
    """Return the command for the log; a procedure by its digest, not its text."""
    audited = as_json(args)
    if isinstance(args, Checked):
        del audited["procedure"]["text"]
    return audited
