"""Opens a rig to read its channels: the cycle runs at rest, nothing is armed or recorded.

The processes are those of a real run (:mod:`rigd.daemon.forms`) without the recorder: the caller
takes the rows out of the rings (buffers of rows). The rings are in a separate folder, so that
no process takes them for those of a run whose samples must be saved.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Final

from rigd.config.rig import RigConfig, Supervision
from rigd.engine.cycle.wiring import streams_of
from rigd.engine.play.control import Control
from rigd.engine.play.interlocks import Trip
from rigd.engine.play.player import Outcome
from rigd.engine.process.launch import launch, prepare
from rigd.engine.process.process_host import ProcessHost
from rigd.engine.shared import EVENT_SOURCES, Job, RunFolder, state_folder
from rigd.engine.shared.folder import folder_name
from rigd.engine.sink import Rows
from rigd.model.errors import DeviceError
from rigd.model.severity import Severity
from rigd.procedure.program import Recorded
from rigd.record.events.event import Event

#: Rows are taken out of the rings every 50 ms; they hold this much if that stalls.
RING_S: Final = 5.0
#: A device in the cycle reports the end of an action within this time, in s.
ACT_S: Final = 15.0
#: The folder of unarmed sessions in the state folder; no rig's own folder begins with a dot.
FOLDER: Final = ".look"
#: How long a process may be silent while nothing can move, in s.
PATIENCE_S: Final = 600.0


class UnarmedSession:
    """A rig that is open but not armed; made by :func:`open_unarmed`.

    ``rig`` is the rig of the file. ``on_rows`` gets the new rows of each stream, several times a
    second, in time order.
    """

    def __init__(
        self, rig: RigConfig, host: ProcessHost, folder: RunFolder, control: Control
    ) -> None:
        self.rig = rig
        self.folder = folder  #: where its rings are, for a process that shows them
        self.on_rows: Callable[[str, Rows], None] = lambda _, __: None
        self.events: list[Event] = []  #: the events so far, watchdogs and faults among them
        self._host = host
        self._control = control
        self._rings = folder.row_rings(folder.job)
        self._event_rings = [folder.event_ring(source) for source in EVENT_SOURCES]
        host.on_drain = self._drain

    @property
    def t_ns(self) -> int:
        """Unix time now, on the clock of the rows, in ns."""
        return self._host.t_ns

    @property
    def stopped(self) -> bool:
        """Whether the user asked for the end."""
        return self._control.asked is not None

    @property
    def trips(self) -> Sequence[Trip]:
        """The trips so far, each with its interlock from the rig file; no action followed."""
        own = {interlock.name: interlock for interlock in self.rig.interlocks}
        return [replace(trip, interlock=own[trip.interlock.name]) for trip in self._host.trips]

    def open(self) -> Sequence[str]:
        """Open every link and device; return the failures, one sentence each."""
        return self._after_events(self._host.open(judge=False))

    def judge(self) -> Sequence[str]:
        """Return the reasons why the rig cannot be armed; every watchdog acts once for this."""
        return self._after_events(self._host.judge())

    def active_interlocks(self) -> Sequence[Trip]:
        """Return the interlocks that are tripped now, each with its last trip."""
        names = self._host.active_interlocks()
        last = {trip.interlock.name: trip for trip in self.trips}
        # The cycle reports one trip per cycle: if several came at once, the others follow.
        return [last[name] for name in names if name in last]

    def loads(self) -> Mapping[str, float]:
        """Return the used share of the capacity of each link that measures it; 0 to 1."""
        loads = self._host.loads()
        return {name: load for name, load in loads.items() if load is not None}

    def first_rows(self) -> None:
        """Read the rig until every device has given a row.

        The rows from before are delivered: those of derived channels have no value yet.

        Raises:
            DeviceError: see :meth:`rest`; a device that gives none counts as failed.
        """
        self._raise_on(self._host.settle(1))
        self._drain()

    def rest(self, seconds: float) -> None:
        """Read the rig for so long, or until the user asks for the end.

        Raises:
            DeviceError: a device, or the cycle, has failed; the rig is safe.
        """
        until_ns = self.t_ns + round(seconds * 1e9)
        self._raise_on(self._host.rest_while(lambda: not self.stopped and self.t_ns < until_ns))
        self._drain()

    def next_row(self, device: str) -> None:
        """Read the rig until ``device`` has given a row that was taken from now on.

        Raises:
            DeviceError: see :meth:`rest`.
        """
        seen = self._rings[device].head
        self._raise_on(
            self._host.rest_while(lambda: not self.stopped and self._rings[device].head == seen)
        )
        self._drain()

    def act(self, device: str, action: str) -> str | None:
        """Perform an action of a device; return the device's reply, None if the user interrupted.

        Raises:
            DeviceError: it refused, did not answer, or was interrupted.
            LinkError: it cannot be reached.
            ProtocolError: its reply is invalid.
        """
        if self.stopped:
            return None
        try:
            return self._host.act(device, action, ACT_S)
        except DeviceError:
            if self.stopped:
                return None
            raise

    def _raise_on(self, outcome: Outcome | None) -> None:
        if outcome is not None and not self.stopped:
            self._drain()
            raise DeviceError(outcome.reason)

    def _after_events(self, reasons: Sequence[str]) -> Sequence[str]:
        self._drain()
        return reasons

    def _drain(self) -> None:
        for event_ring in self._event_rings:
            self.events += event_ring.drain()
        for name, ring in self._rings.items():
            rows = ring.drain()
            if len(rows):
                self.on_rows(name, rows)


@contextmanager
def open_unarmed(
    rig: RigConfig, control: Control, *, command: str, held: RunFolder | None = None
) -> Iterator[UnarmedSession]:
    """Take ``rig`` and prepare to open it; at the end it is always safe, closed and free.

    ``command`` is shown to a process that wants the rig meanwhile. ``held`` is the rig's folder if
    the caller has taken it, and keeps it.

    Raises:
        Blocked: the rig is in use.
        RecordingError: there is no room for its rings.
    """
    lock = held or RunFolder.take(rig.name, command=command)
    path = state_folder() / FOLDER / folder_name(rig.name)
    shutil.rmtree(path, ignore_errors=True)  # left by an unarmed session that was killed
    try:
        path.mkdir(mode=0o700, parents=True)
        folder = RunFolder(path, lock.lock_fd)
        streams = tuple(streams_of(rig))
        job = Job(rig.name, Path(os.devnull), streams, time.time_ns())
        every_row = {stream.name: Recorded() for stream in streams}
        prepare(rig, folder, job, record=every_row, ring_s=RING_S)
        host = launch(_harmless(rig), folder, job, control, record=every_row)
        try:
            yield UnarmedSession(rig, host, folder, control)
        finally:
            host.make_safe()
            host.close()
    finally:
        shutil.rmtree(path, ignore_errors=True)
        if held is None:
            lock.release()


def _harmless(rig: RigConfig) -> RigConfig:
    """Return ``rig`` with interlocks that only report, and without limits on silence.

    Nothing is armed, so nothing must end quickly: a terminal may be stopped (Ctrl-S). Nor does
    anything follow a setpoint.
    """
    reporting = tuple(
        replace(interlock, action=Severity.WARN, latch=False)
        for interlock in rig.interlocks
        if interlock.follows is None
    )
    return replace(rig, interlocks=reporting, supervision=Supervision(PATIENCE_S, PATIENCE_S))
