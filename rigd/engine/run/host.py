"""Defines the interface through which a run commands the control cycle.

In virtual time, and for simulations at another speed than the wall clock, the cycle runs in the
same process as the run (:class:`~rigd.engine.process.in_process.InProcessHost`). On real devices
the cycle is a process of its own (:class:`~rigd.engine.process.process_host.ProcessHost`). A run
uses only this interface.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from rigd.engine.cycle.cycle import CycleCounters
from rigd.engine.play.interlocks import Trip
from rigd.engine.play.player import Outcome
from rigd.procedure.program import CycleProgram


class Host(Protocol):
    """Plays cycle programs on the devices of a rig and records the rows and events that result.

    A method that returns an :class:`Outcome` returns it if the cycle had to act: an interlock, a
    request to stop, a device that failed. Every method may raise RecordingError if the recording
    cannot be continued.
    """

    trial: int  #: trial number of the events
    on_drain: Callable[[], None]  #: called from time to time while a program plays

    @property
    def virtual(self) -> bool:
        """Whether the clock never waits."""
        ...

    @property
    def muted(self) -> bool:
        """Whether rows and events are dropped instead of recorded; only in virtual time."""
        ...

    @muted.setter
    def muted(self, muted: bool) -> None: ...

    @property
    def t_ns(self) -> int:
        """Unix time of the present slot, in ns."""
        ...

    @property
    def run_s(self) -> float:
        """Time of the run so far, in s."""
        ...

    @property
    def segment(self) -> str:
        """Name of the present step."""
        ...

    @property
    def held(self) -> bool:
        """Whether a pause holds the present step, or the program ended while it did."""
        ...

    @property
    def counters(self) -> CycleCounters:
        """Counters of the cycle."""
        ...

    @property
    def trips(self) -> Sequence[Trip]:
        """All trips so far."""
        ...

    @property
    def overruns(self) -> int:
        """Rows lost because a ring was full."""
        ...

    def open(self) -> Sequence[str]:
        """Open every device and test its watchdog; return why the rig cannot be armed."""
        ...

    def identities(self) -> Mapping[str, str]:
        """Return the identity that each device reported, by name, after all are open."""
        ...

    def arming_blockers(self) -> Sequence[str]:
        """Return the reasons why the rig, at rest, cannot be armed; one sentence each."""
        ...

    def arm(self) -> Outcome | None:
        """Enable every device, at rest."""
        ...

    def play(self, program: CycleProgram, then: CycleProgram | None = None) -> Outcome:
        """Play ``program`` to its end and return how it ended.

        ``then`` is the probable next program: if ``program`` reaches its end, the cycle continues
        with ``then`` at once, even if the request for it arrives late.
        """
        ...

    def ask(self, question: Callable[[], None]) -> Outcome | None:
        """Run ``question``, which may wait for a person, while the rig stays at rest."""
        ...

    def come_to_rest(self) -> Outcome | None:
        """Take the setpoints to rest, each within its rate, and return when they are there."""
        ...

    def rest_while(self, condition: Callable[[], bool]) -> Outcome | None:
        """Keep the rig at rest while ``condition`` holds."""
        ...

    def settle(self, count: int) -> Outcome | None:
        """Run ``count`` cycles at rest, and more until every device has returned a row."""
        ...

    def lockout_reason(self) -> str:
        """Return why motion is locked out, or ""."""
        ...

    def flush(self) -> None:
        """Have all rows and events so far in the recording, or soon if another process writes."""
        ...

    def drain(self) -> None:
        """Write the rows and events recorded so far to the sink."""
        ...

    def event(self, kind: str, data: Mapping[str, object]) -> None:
        """Record an event with the time of the present slot."""
        ...

    def make_safe(self) -> Sequence[str]:
        """Bring every device to its safe state; return the errors, one sentence each."""
        ...

    def read_on(self, for_s: float, *, asking: bool) -> Mapping[str, float]:
        """Record for so long what devices show after :meth:`make_safe`; nothing is written.

        ``asking``: also of devices that must be asked for it, which feeds their watchdogs. It ends
        as soon as the rig rests, if its file states by which channels (``at_rest``). Of these the
        last values are returned that show no rest, in SI; NaN of one that was not read.
        """
        ...

    def close(self) -> None:
        """Close every device, then complete the recording."""
        ...
