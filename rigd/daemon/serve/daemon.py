"""Contains the main function of the daemon: builds its parts, runs it, and ends it on a signal."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Final

from rigd.config.rig import RigConfig
from rigd.daemon.live import Feed
from rigd.daemon.live.foxglove import FoxgloveServer
from rigd.daemon.serve.compared_pages import ComparedPages
from rigd.daemon.serve.handlers import Parts
from rigd.daemon.serve.idle_rig import IdleRig
from rigd.daemon.serve.library import Library
from rigd.daemon.serve.recordings import Recordings
from rigd.daemon.serve.service import RigService
from rigd.daemon.serve.steering import Steering
from rigd.daemon.serve.upkeep.audit import AuditLog
from rigd.daemon.serve.upkeep.certificates import CertificateWatch
from rigd.daemon.serve.upkeep.descriptors import raise_limit
from rigd.daemon.serve.upkeep.notices import Notices
from rigd.daemon.serve.upkeep.notify import Notifier
from rigd.daemon.serve.upkeep.recovery import Interruptions
from rigd.daemon.serve.upkeep.supervised_process import SupervisedProcess
from rigd.daemon.serve.upkeep.trips import TripMemory
from rigd.daemon.serve.worker import CalculationWorker
from rigd.engine.shared import RunFolder
from rigd.engine.shared.folder import folder_name
from rigd.engine.sink import Rows
from rigd.engine.system.realtime import as_program, before_programs
from rigd.model.channels import Stream
from rigd.record.events.event import Event
from rigd.remote.server import Lease, Server

#: The daemon does its periodic work this often, and at once if something has changed; in s.
TICK_S: Final = 0.25
#: The processes of a daemon that was killed make the rig safe and complete the recording within
#: this time, in s.
PATIENCE_S: Final = 20.0

#: A check may take so long (its client waits a little longer), and so much memory, in bytes.
CHECK_S: Final = 25.0
CHECK_MEMORY: Final = 1 << 30


@dataclass(frozen=True)
class DaemonOptions:
    """The rig that the daemon serves, and its options.

    ``runs`` is the folder of recordings, ``procedures`` that of the lab's own procedures.
    ``monitored``: channels are shown between runs too. ``foxglove`` is a port, None for none.
    ``panel`` is the command that starts a panel, () for none.
    """

    rig: RigConfig
    runs: Path
    procedures: Path
    monitored: bool = False
    foxglove: int | None = None
    panel: Sequence[str] = ()


@dataclass
class Signals:
    """Requests that signals have made; the signal handler only sets flags and takes no lock."""

    reason: str = ""  #: why the daemon is to end, or ""
    steering: Steering | None = None
    asked: list[str] = field(default_factory=list)  #: in words, not yet shown to the operator

    def handle(self, number: int, frame: FrameType | None) -> None:
        """Take a signal."""
        self.reason = f"stopped by {signal.Signals(number).name}"
        stop = None if self.steering is None else self.steering.leave(self.reason)
        what = "nothing runs" if stop is None else f"{stop.word} of the run"
        self.asked.append(f"{self.reason}: {what}")

    def steer(self, steering: Steering) -> None:
        """Let signals end the present run from now on."""
        self.steering = steering
        if self.reason:
            steering.leave(self.reason)


def serve(options: DaemonOptions, announce: Callable[[str], None]) -> None:
    """Serve a rig until a signal; the run in progress is then stopped, and its file completed.

    A second signal aborts the run, a third drops power. ``announce`` gets lines for the user or
    program that started the daemon.

    Raises:
        Blocked: the rig is in use.
        LinkError: an address cannot be listened on.
        RigdError: a required file cannot be read or written.
    """
    signals = Signals()
    with _handling(signals), Notifier() as notifier, ExitStack() as stack:
        status_changed = threading.Event()
        parts, server = _compose(options, stack, status_changed.set, announce)
        service = RigService(parts, server.refused, status_changed.set, server.crowding)
        signals.steer(parts.steering)
        server.start(service)
        companions = []
        if options.panel:
            panel = SupervisedProcess(
                "the panel", options.panel, parts.notices, spare=(*options.panel, "--spare")
            )
            companions.append(stack.enter_context(panel))
        parts.steering.show()
        notifier.ready()
        announce(f"{options.rig.name} is served on {', '.join(options.rig.remote.listen)}")

        hung = ""

        def tick() -> None:
            nonlocal hung
            if status_changed.wait(TICK_S):
                status_changed.clear()
                server.publish_status(service)
            while signals.asked:
                parts.notices.note(signals.asked.pop(0), "warning")
            service.tend()
            # Without a sign of life, the service manager starts another daemon.
            if not (hangs := server.hangs):
                hung = ""
                notifier.alive(service.doing)
            elif hangs != hung:
                hung = hangs
                notifier.hanging(hangs)
                parts.notices.note(f"clients are not served any more: {hangs}", "error")

        while not signals.reason:
            tick()
            for companion in companions:
                companion.tend()
        notifier.ending()
        while parts.steering.running is not None:
            tick()
        service.tend()


def _compose(
    options: DaemonOptions,
    stack: ExitStack,
    changed: Callable[[], None],
    announce: Callable[[str], None],
) -> tuple[Parts, Server]:
    """Take the rig and build the parts of the daemon; ``stack`` ends them in reverse order."""
    rig, runs = options.rig, options.runs
    raise_limit()
    folder = RunFolder.take(rig.name, command="rigd serve", patience_s=PATIENCE_S)
    stack.callback(folder.release)
    recordings = Recordings(runs)
    recordings.make_folder()
    lease = Lease()
    stack.enter_context(before_programs())  # with every thread from here on, zenoh's too
    server = stack.enter_context(Server(rig.name, rig.remote, lease))
    raw: Callable[[Stream, Rows], None] = _nowhere
    happened: Callable[[Event], None] = _ignore
    if options.foxglove is not None:
        with as_program():  # its viewers are not authenticated
            foxglove = FoxgloveServer(rig, options.foxglove)
        stack.callback(foxglove.stop)
        announce(f"Foxglove: {foxglove.address}")
        raw, happened = foxglove.show, foxglove.happened
    feed = stack.enter_context(Feed(rig, server.publisher, raw=raw, happened=happened))
    notices = Notices(changed)
    certificates = CertificateWatch(rig.remote, notices.note)
    name = folder_name(rig.name)
    trips = TripMemory(runs / f"{name}.trips.json")
    interruptions = Interruptions(rig.name, recordings, notices)
    with as_program():  # it may compute for long
        interruptions.recover(folder, trips)
    library = Library(rig, options.procedures)
    audit = AuditLog(runs / f"{name}.audit.jsonl")
    aside = CalculationWorker()
    stack.callback(aside.close)
    checks = CalculationWorker(CHECK_S, CHECK_MEMORY)
    stack.callback(checks.close)
    comparing = CalculationWorker()
    stack.callback(comparing.close)

    def settle() -> None:
        aside.cancel("dry_run", "a run begins")  # its result comes too late
        interruptions.settle(folder)

    steering = Steering(
        rig,
        folder,
        runs,
        library=library,
        lease=lease,
        feed=feed,
        trips=trips,
        notices=notices,
        looks=IdleRig(rig, folder, feed, monitored=options.monitored, notify=notices.note),
        changed=changed,
        ended=lambda last: interruptions.ended(last.run),
        settle=settle,
    )
    stack.callback(steering.close)
    audit.write("rigd", "serve", {"listen": list(rig.remote.listen)})
    stack.callback(audit.write, "rigd", "end", {})
    parts = Parts(
        rig,
        lease,
        feed,
        steering,
        recordings,
        library,
        interruptions,
        trips,
        notices,
        audit,
        aside,
        checks,
        ComparedPages(comparing),
        certificates,
    )
    return parts, server


def _nowhere(stream: Stream, rows: Rows) -> None:
    """Discard raw rows, which only Foxglove uses."""


def _ignore(event: Event) -> None:
    """Discard an event of a run, as :func:`_nowhere` does rows."""


@contextmanager
def _handling(signals: Signals) -> Iterator[None]:
    """Let signals end the daemon inside; a signal ignored before (nohup) stays ignored."""
    numbers = [
        number
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        if signal.getsignal(number) is not signal.SIG_IGN
    ]
    before = {number: signal.signal(number, signals.handle) for number in numbers}
    # Ctrl-Z would stop this process, and the cycle would take the daemon for dead.
    before[signal.SIGTSTP] = signal.signal(signal.SIGTSTP, signal.SIG_IGN)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
