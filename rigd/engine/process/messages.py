"""Defines the messages between the daemon and the cycle process: one pickled object per packet.

The daemon sends commands. A question is a command that names the type of its answer. The cycle
process sends answers, the endings of commands, and notifications (a step, a trip, a notice). Both
processes run the same code, and no other process has an end of the socket.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Generic, TypeVar

from rigd.config.rig import RigConfig
from rigd.engine.play.interlocks import Trip
from rigd.engine.play.player import Outcome
from rigd.model.errors import RigdError
from rigd.model.severity import Severity
from rigd.procedure.program import CycleProgram, Recorded
from rigd.sdk.peers import Peer

T = TypeVar("T")

#: The file of the job in the run's folder.
JOB: Final = "cycle.pickle"
#: Longest packet on the socket; a longer program is passed in a file.
MAX_PACKET: Final = 100_000


@dataclass(frozen=True)
class CycleJob:
    """The data with which the cycle process builds its rig; pickled into the run's folder.

    ``record`` has the streams that are recorded, and which of their rows.
    """

    rig: RigConfig
    record: Mapping[str, Recorded]
    seed: int


@dataclass(frozen=True)
class Command:
    """A command for the cycle process; every reply has the same ``serial``."""

    serial: int


@dataclass(frozen=True)
class Question(Command, Generic[T]):
    """A command that is replied by an Answer of type ``T``."""


@dataclass(frozen=True)
class Open(Question[Sequence[str]]):
    """Open every device; the answer is the reasons why the rig cannot be armed, one sentence each.

    ``judge`` False: only the devices that could not be opened. :class:`Judge` asks for the rest.
    ``peers``: where the daemon has opened TCP ports; see :mod:`rigd.sdk.peers`.
    """

    judge: bool = True
    peers: Mapping[Peer, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Peers(Question[Mapping[Peer, str]]):
    """Ask where the cycle has opened TCP ports; see :mod:`rigd.sdk.peers`."""


@dataclass(frozen=True)
class Judge(Question[Sequence[str]]):
    """Ask every open device whether it may be armed, and test its watchdog; answered like Open."""


@dataclass(frozen=True)
class ReadOn(Question[bool]):
    """Record on until Close, after MakeSafe; answered whether any device can be read.

    ``asking``: also of devices that must be asked for it.
    """

    asking: bool = False


@dataclass(frozen=True)
class Moving(Question[Mapping[str, float]]):
    """The values that show, after ReadOn, that the rig does not rest; in SI, by channel."""


@dataclass(frozen=True)
class ArmingBlockers(Question[Sequence[str]]):
    """Ask for the reasons why the rig, at rest, cannot be armed; one sentence each."""


@dataclass(frozen=True)
class LockoutReason(Question[str]):
    """Ask for the reason why motion is locked out; the answer is "" if motion is permitted."""


@dataclass(frozen=True)
class ActiveInterlocks(Question[Sequence[str]]):
    """Ask for the names of the interlocks that are tripped."""


@dataclass(frozen=True)
class Identities(Question[Mapping[str, str]]):
    """Ask for the identity that every device in the cycle reports, by device name."""


@dataclass(frozen=True)
class Loads(Question[Mapping[str, float | None]]):
    """Ask for the share of its capacity that each link uses, 0 to 1; None if it is not known."""


@dataclass(frozen=True)
class Act(Question["Acted"]):
    """Begin an action of a device; the answer follows in a later cycle, when the action is over."""

    device: str
    action: str


@dataclass(frozen=True)
class Change(Question[Sequence[str]]):
    """Change the plant of a simulated rig; the answer is the list of errors."""

    quantity: str
    value: float | str


@dataclass(frozen=True)
class MakeSafe(Question[Sequence[str]]):
    """Make every device safe and stop the cycle; the answer is the list of errors."""


@dataclass(frozen=True)
class Close(Question[Sequence[str]]):
    """Close every device and end the process; the answer is the list of errors."""


@dataclass(frozen=True)
class Begin(Command):
    """Begin a task that ends with an outcome; ``last_received`` is the serial of the last outcome.

    If the cycle has acted since, that outcome is the answer, and nothing begins: the daemon may
    have stopped listening before the cycle reported it.
    """

    last_received: int


@dataclass(frozen=True)
class Arm(Begin):
    """Enable every device; answered by Ended when all are enabled."""


@dataclass(frozen=True)
class Play(Begin):
    """Play a program, and ``then`` without a gap; answered by Ended of the program.

    ``file`` contains both if they are long. Neither is given if the program was ``then`` of the
    last program: it plays already, or has ended.
    """

    trial: int
    program: CycleProgram | None = None
    then: CycleProgram | None = None
    file: str = ""


@dataclass(frozen=True)
class Rest(Begin):
    """Take the setpoints to rest and keep running; Ended comes only if the cycle had to act."""

    trial: int


@dataclass(frozen=True)
class Request(Command):
    """Request a stop, abort or estop; has no reply."""

    stop: Severity
    reason: str


@dataclass(frozen=True)
class Pause(Command):
    """Request a pause, or its end; has no reply. ``last_trial``: why no trial follows, or ""."""

    wanted: bool
    last_trial: str


@dataclass(frozen=True)
class Draw(Command):
    """Let the plant of a simulated rig draw from the seed of a trial; has no reply."""

    seed: int


@dataclass(frozen=True)
class EndTrial(Command):
    """Let derived channels know no parameter that differs by trial; has no reply."""


@dataclass(frozen=True)
class Acknowledge(Command):
    """Permit a latched interlock to clear; has no reply."""

    interlock: str


@dataclass(frozen=True)
class Answer(Generic[T]):
    """The answer to a question."""

    serial: int
    value: T


@dataclass(frozen=True)
class Acted:
    """Holds the result that a device reports for an action, or the error that ended the action."""

    reply: str
    error: RigdError | None = None


@dataclass(frozen=True)
class Ended:
    """Holds the outcome of the command ``serial``."""

    serial: int
    outcome: Outcome


@dataclass(frozen=True)
class Entered:
    """A step of the program has begun."""

    name: str


@dataclass(frozen=True)
class Tripped:
    """An interlock has tripped."""

    trip: Trip


@dataclass(frozen=True)
class Notice:
    """A line for the operator."""

    line: str


@dataclass(frozen=True)
class ReadOnEnded:
    """Nothing is recorded any more after a run: the rig rests, or no device can be read."""


#: Unsolicited reports of the cycle.
Notification = Entered | Tripped | Notice | ReadOnEnded
