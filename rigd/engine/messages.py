"""Messages between the daemon and the cycle process: one pickled object per packet.

To the cycle go commands, among them questions; a question names the type of its answer. From the
cycle come answers, endings and news. Both ends run the same code and nobody else holds an end of
the socket.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

from rigd.config.rig import RigConfig
from rigd.engine.interlocks import Trip
from rigd.engine.player import Outcome
from rigd.model.errors import RigdError
from rigd.model.severity import Severity
from rigd.procedure.program import CycleProgram, Recorded

T = TypeVar("T")

#: The file of the job in the run's folder.
JOB: Final = "cycle.pickle"
#: A packet on the socket is at most this long; a longer program goes by way of a file.
MAX_PACKET: Final = 100_000


@dataclass(frozen=True)
class CycleJob:
    """What the cycle process needs to build its rig; pickled into the run's folder.

    ``record`` names the streams that are recorded, and what of them.
    """

    rig: RigConfig
    record: Mapping[str, Recorded]
    seed: int


@dataclass(frozen=True)
class Command:
    """Something to do; what comes of it carries the same ``serial``."""

    serial: int


@dataclass(frozen=True)
class Question(Command, Generic[T]):
    """A command that is replied by an Answer of type ``T``."""


@dataclass(frozen=True)
class Open(Question[Sequence[str]]):
    """Open every device; answered with what keeps the rig from being armed, a sentence each.

    ``judge`` False: only with what could not be opened. :class:`Judge` asks for the rest.
    """

    judge: bool = True


@dataclass(frozen=True)
class Judge(Question[Sequence[str]]):
    """Ask every open device whether it may be armed, and prove its watchdog; answered as Open."""


@dataclass(frozen=True)
class Unfit(Question[Sequence[str]]):
    """Ask why the rig, looked at in rest, is not fit to be armed; a sentence each."""


@dataclass(frozen=True)
class Barred(Question[str]):
    """Ask why nothing may move any more; answered with "" if it may."""


@dataclass(frozen=True)
class Standing(Question[Sequence[str]]):
    """Ask for the names of the interlocks that stand tripped."""


@dataclass(frozen=True)
class Identities(Question[Mapping[str, str]]):
    """Ask what every device in the cycle said it is, by name."""


@dataclass(frozen=True)
class Loads(Question[Mapping[str, float | None]]):
    """Ask which share of its capacity each link carries, 0 to 1; None if it does not know."""


@dataclass(frozen=True)
class Act(Question["Acted"]):
    """Begin an action of a device; answered once it is over, in the cycles that follow."""

    device: str
    action: str


@dataclass(frozen=True)
class Change(Question[Sequence[str]]):
    """Change the plant of a simulated rig; answered with what was wrong, if anything."""

    quantity: str
    value: float | str


@dataclass(frozen=True)
class MakeSafe(Question[Sequence[str]]):
    """Make every device safe and stop the cycle; answered with what went wrong."""


@dataclass(frozen=True)
class Close(Question[Sequence[str]]):
    """Close everything and end; answered with what went wrong."""


@dataclass(frozen=True)
class Begin(Command):
    """Something that ends with an outcome; ``heard`` is the serial of the last one that was heard.

    If the cycle has acted since, that is the answer, and nothing begins: the daemon may have
    stopped listening (a rest that was long enough) before the cycle reported it.
    """

    heard: int


@dataclass(frozen=True)
class Arm(Begin):
    """Enable every device; replied by Ended once all are."""


@dataclass(frozen=True)
class Play(Begin):
    """Play a program, and ``then`` without a gap; replied by Ended of the program.

    ``file`` holds both if they are long. Neither is given if the program is the one that was the
    last one's ``then``: it plays already, or has ended.
    """

    trial: int
    program: CycleProgram | None = None
    then: CycleProgram | None = None
    file: str = ""


@dataclass(frozen=True)
class Rest(Begin):
    """Let the setpoints go to rest, and run; Ended comes only if the cycle had to act."""

    trial: int


@dataclass(frozen=True)
class Request(Command):
    """Stop, abort or estop; no reply of its own."""

    stop: Severity
    reason: str


@dataclass(frozen=True)
class Acknowledge(Command):
    """Let a latched interlock clear; no reply of its own."""

    interlock: str


@dataclass(frozen=True)
class Answer(Generic[T]):
    """The answer to a question."""

    serial: int
    value: T


@dataclass(frozen=True)
class Acted:
    """What a device said of an action, or the error that it ended with."""

    said: str
    error: RigdError | None = None


@dataclass(frozen=True)
class Ended:
    """How what was commanded by ``serial`` ended."""

    serial: int
    outcome: Outcome


@dataclass(frozen=True)
class Entered:
    """A step of the program began."""

    name: str


@dataclass(frozen=True)
class Tripped:
    """An interlock acted."""

    trip: Trip


@dataclass(frozen=True)
class Notice:
    """A line for the operator."""

    line: str


#: What the cycle reports without being asked.
News = Entered | Tripped | Notice
