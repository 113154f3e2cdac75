"""The interface through which a run reaches the control cycle, in this process or another.

In virtual time, and for simulations paced otherwise than the wall, the cycle runs in this process
(:class:`~rigd.engine.in_process.InProcessHost`); on real devices it is a process of its own
(:class:`~rigd.engine.process_host.ProcessHost`). The run knows only this.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from rigd.engine.cycle import CycleCounters
from rigd.engine.interlocks import Trip
from rigd.engine.player import Outcome
from rigd.procedure.program import CycleProgram


class Host(Protocol):
    """Plays cycle programs on the devices of a rig and records what they give.

    Whatever returns an :class:`Outcome` returns it where the cycle had to act: an interlock, a
    request to stop, a device that failed. Every method may raise RecordingError where the
    recording cannot be kept.
    """

    trial: int  #: number of the trial that events belong to
    on_drain: Callable[[], None]  #: called now and then while something plays

    @property
    def virtual(self) -> bool:
        """Whether the clock never waits."""
        ...

    @property
    def t_ns(self) -> int:
        """Unix time of the slot under way, in ns."""
        ...

    @property
    def run_s(self) -> float:
        """Time of the run so far, in s."""
        ...

    @property
    def segment(self) -> str:
        """Name of the step that plays."""
        ...

    @property
    def counters(self) -> CycleCounters:
        """What the cycle counts about itself."""
        ...

    @property
    def trips(self) -> Sequence[Trip]:
        """Everything that tripped so far."""
        ...

    @property
    def overruns(self) -> int:
        """Rows lost because a ring was full."""
        ...

    def open(self) -> Sequence[str]:
        """Open every device and prove its watchdog; return what keeps the rig from being armed."""
        ...

    def identities(self) -> Mapping[str, str]:
        """Return what every device said it is, by name, once all are open."""
        ...

    def unfit(self) -> Sequence[str]:
        """Return why the rig, looked at in rest, is not fit to be armed; a sentence each."""
        ...

    def arm(self) -> Outcome | None:
        """Enable every device, at rest."""
        ...

    def play(self, program: CycleProgram, then: CycleProgram | None = None) -> Outcome:
        """Play ``program`` to its end and return how it ended.

        ``then`` is what will be played next, if it comes to that: where ``program`` plays to its
        end, the cycle goes on with it at once, whether or not anybody asks for it in time.
        """
        ...

    def ask(self, question: Callable[[], None]) -> Outcome | None:
        """Run ``question``, which may wait for a person, while the rig stays at rest."""
        ...

    def come_to_rest(self) -> Outcome | None:
        """Let the setpoints go to rest, each within its rate, and return once they are there."""
        ...

    def rest_while(self, condition: Callable[[], bool]) -> Outcome | None:
        """Keep the rig at rest as long as ``condition`` holds."""
        ...

    def settle(self, count: int) -> Outcome | None:
        """Run ``count`` cycles at rest, and more until every device has given a row."""
        ...

    def ends_everything(self) -> str:
        """Return why nothing may move any more, or ""."""
        ...

    def drain(self) -> None:
        """See to it that what was recorded so far is handed on."""
        ...

    def event(self, kind: str, data: Mapping[str, object]) -> None:
        """Record one event, stamped with the slot under way."""
        ...

    def make_safe(self) -> Sequence[str]:
        """Bring every device to its safe state; return what went wrong, a sentence each."""
        ...

    def close(self) -> None:
        """Close every device, then finish the recording."""
        ...
