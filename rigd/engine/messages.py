"""Messages between the daemon and the cycle process: one pickled object per packet.

Both ends run the same code and nobody else holds an end of the socket.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rigd.config.rig import RigConfig
from rigd.engine.interlocks import Trip
from rigd.engine.player import Outcome
from rigd.model.errors import RigdError
from rigd.model.severity import Severity
from rigd.procedure.program import CycleProgram, Recorded

#: A packet on the socket is at most this long; a longer program goes by way of a file.
MAX_PACKET = 100_000


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
    """Something to do; the reply carries the same ``serial``."""

    serial: int


@dataclass(frozen=True)
class Open(Command):
    """Open every device; replied by Said with what keeps the rig from being armed.

    ``judge`` False: only with what could not be opened. :class:`Judge` asks for the rest.
    """

    judge: bool = True


@dataclass(frozen=True)
class Judge(Command):
    """Ask every open device whether it may be armed, and prove its watchdog; replied by Said."""


@dataclass(frozen=True)
class Act(Command):
    """Begin an action of a device; replied by Acted once it is over, in the cycles that follow."""

    device: str
    action: str


@dataclass(frozen=True)
class Begin(Command):
    """Something that ends with an outcome; ``heard`` is the serial of the last one that was heard.

    Where the cycle has acted since, that is the answer, and nothing begins: the daemon may have
    stopped listening (a rest that was long enough) before it was told.
    """

    heard: int


@dataclass(frozen=True)
class Arm(Begin):
    """Enable every device; replied by Ended once all are."""


@dataclass(frozen=True)
class Play(Begin):
    """Play a program, and ``then`` without a gap; replied by Ended of the program.

    ``file`` holds both where they are long. Neither, where the program is the one that was the
    last one's ``then``: it plays already, or has ended.
    """

    trial: int
    program: CycleProgram | None = None
    then: CycleProgram | None = None
    file: str = ""


@dataclass(frozen=True)
class Rest(Begin):
    """Let the setpoints go to rest, and run; Ended comes only where the cycle had to act."""

    trial: int


@dataclass(frozen=True)
class Change(Command):
    """Change the plant of a simulated rig; replied by Said with what was wrong, if anything."""

    quantity: str
    value: float | str


@dataclass(frozen=True)
class Ask(Command):
    """Ask ``unfit``, ``barred`` or ``standing`` (interlocks by name); replied by Said.

    ``identities`` is replied by Said with name and identity of every device in turn.
    ``loads`` is replied by Said with nothing, behind an event with the load of every link.
    """

    what: str


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
class MakeSafe(Command):
    """Make every device safe and stop the cycle; replied by Said with what went wrong."""


@dataclass(frozen=True)
class Close(Command):
    """Close everything and end; replied by Said with what went wrong."""


@dataclass(frozen=True)
class Said:
    """The answer to a command, in sentences."""

    serial: int
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class Acted:
    """What a device said of an action, or the error that it ended with."""

    serial: int
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
