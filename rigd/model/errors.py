"""Defines the error classes of rigd; the class of an error names the person who can act.

RigdError
├── ConfigError      the author of a file: what is wrong, where (file:line:column), what to do
├── LinkError        the person who wired the rig: a device cannot be reached
├── ProtocolError    the device: it answered, but not as its manual says
├── DeviceError      the device: it reports a fault, or gave no row in time
├── Blocked          the operator: preflight refuses to arm, and reports what is missing
├── ProcedureError   the operator: a step did not end as the procedure demands
├── RecordingError   the person who keeps the files: a recording cannot be written or read
├── DataError        the analyst: a recording can be read but cannot answer the question
└── Refusal          the client of a daemon: the daemon refuses, nothing has changed (rigd.remote)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from textwrap import indent


class Exit(IntEnum):
    """Exit codes of the command line, documented in ``rigd --help``."""

    OK = 0
    INTERNAL = 1  #: a bug in rigd, or an error without its own code
    BAD_INPUT = 2  #: wrong arguments, rig file or procedure file; nothing moved
    BLOCKED = 3  #: preflight refused to arm; nothing moved
    TRIPPED = 4  #: an interlock or a device fault ended the run
    STOPPED = 5  #: a person stopped, aborted or estopped the run
    FAILED = 6  #: a step of the procedure did not end as demanded
    BAD_DATA = 7  #: a recording cannot be written, read, or used for the request
    MISFIT = 8  #: the model does not fit the data: no number is given, or the model is rejected
    REJECTED = 9  #: a result is not what the procedure demands, not decided, or read in no trial


@dataclass(frozen=True)
class Place:
    """A place in a text file; line and column count from 1."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


class RigdError(Exception):
    """Root of every error that rigd raises on purpose; raise a subclass, never the root.

    ``hint`` is the remedy, and is printed below the message. ``entry`` are the keys and list
    indices of the option of a device that is wrong, if the error is about one.
    """

    exit_code = Exit.INTERNAL
    entry: tuple[str | int, ...] = ()

    def __init__(self, message: str, *, hint: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint or None

    def __str__(self) -> str:
        return self.message if self.hint is None else f"{self.message}\n  {self.hint}"

    def __reduce__(self) -> tuple[object, ...]:
        """Return how another process makes it, whatever the arguments of its class are."""
        return _made_again, (type(self), self.args, self.__dict__)

    @property
    def one_line(self) -> str:
        """The same in one line, as the reason for the end of a run."""
        return self.message if self.hint is None else f"{self.message} ({self.hint})"


def _made_again(
    kind: type[RigdError], args: tuple[object, ...], state: dict[str, object]
) -> RigdError:
    error = kind.__new__(kind, *args)
    error.__dict__.update(state)
    return error


class ConfigError(RigdError):
    """A rig or procedure file is wrong; contains every problem found, each with its place.

    ``lacks`` names what the file needs and its rig lacks (``scale.mass``); empty if anything else
    is wrong.
    """

    exit_code = Exit.BAD_INPUT

    def __init__(
        self,
        message: str,
        *,
        place: Place | None = None,
        hint: str | None = None,
        lacks: str = "",
    ) -> None:
        super().__init__(message, hint=hint)
        self.place = place
        self.lacks = lacks
        self.others: tuple[ConfigError, ...] = ()

    @classmethod
    def several(cls, errors: Sequence[ConfigError]) -> ConfigError:
        """Return the first of ``errors`` with the others attached, so that one report names all."""
        first, *rest = errors
        first.others = (*first.others, *rest)
        return first

    def __str__(self) -> str:
        text = super().__str__()
        if self.place is not None:
            text = f"{self.place}: {text}"
        return "\n".join([text, *(str(other) for other in self.others)])


class OtherRigError(ConfigError):
    """A procedure whose only errors are devices that the rig lacks; ``missing`` names them."""

    def __init__(
        self, procedure: str, rig: str, missing: tuple[str, ...], place: Place | None
    ) -> None:
        super().__init__(
            f"{procedure} is for another rig: {rig} has no {', '.join(missing)}",
            place=place,
            hint="name the rig that has them with --rig; `rigd check FILE --rig RIG` checks that",
        )
        self.missing = missing


class LinkError(RigdError):
    """A device cannot be reached."""

    exit_code = Exit.TRIPPED


class ProtocolError(RigdError):
    """A device answered, but not as its manual says."""

    exit_code = Exit.TRIPPED


class DeviceError(RigdError):
    """A device reports a fault, or gave no row in time."""

    exit_code = Exit.TRIPPED


class Blocked(RigdError):
    """Preflight refuses to arm; ``reasons`` names everything that is missing.

    ``what`` is the statement that the reasons explain. Several reasons are printed below one
    another, because each may have a hint.
    """

    exit_code = Exit.BLOCKED

    def __init__(self, reasons: Sequence[str], what: str = "the rig is not armed") -> None:
        super().__init__(f"{what}: " + "; ".join(reasons))
        self.what = what
        self.reasons = tuple(reasons)

    def __str__(self) -> str:
        if len(self.reasons) == 1:
            return super().__str__()
        return "\n".join([f"{self.what}:", *(indent(reason, "  ") for reason in self.reasons)])


class ProcedureError(RigdError):
    """A step did not end as the procedure demands (timeout, refused answer)."""

    exit_code = Exit.FAILED


class RecordingError(RigdError):
    """A recording cannot be written or read."""

    exit_code = Exit.BAD_DATA


class DataError(RigdError):
    """A recording can be read but does not contain the required data."""

    exit_code = Exit.BAD_DATA
