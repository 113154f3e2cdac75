"""Defines the arguments of requests: one model for each verb (kind of request) with arguments."""

from __future__ import annotations

import hashlib
from typing import Annotated, Final, Literal, Self

from pydantic import BeforeValidator, Field, StringConstraints, model_validator

from rigd.model.about import MOST_ENTRIES, MOST_NOTE_LETTERS, SPECIMEN_NAME, About
from rigd.remote.protocol.limits import MAX_COMPARED, MAX_PIECE_BYTES, MAX_REASON
from rigd.remote.protocol.message import Message, Name, Text, User
from rigd.remote.protocol.status import Nanoseconds
from rigd.remote.protocol.stop import stop_reason

#: File name of a recording: never a path.
RUN_NAME: Final = r"[A-Za-z0-9_][A-Za-z0-9._-]{0,199}"
RunName = Annotated[str, StringConstraints(pattern=f"^{RUN_NAME}$")]
#: Of a procedure, an interlock, a device, a parameter.
FileWord = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,59}$")]
#: The values of `--set NAME=VALUE` by name: quantities and words as a person writes them.
Settings = dict[FileWord, Annotated[str, StringConstraints(max_length=200)]]
Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


class NoArguments(Message):
    """For verbs without arguments."""


class ProcedureFile(Message):
    """A procedure, which travels by value."""

    name: FileWord
    text: Annotated[str, StringConstraints(min_length=1)]
    """The file, as its author wrote it."""
    sha256: Sha256
    """The SHA-256 of the text in UTF-8, so that the daemon runs exactly this text."""

    @classmethod
    def of(cls, name: str, text: str) -> Self:
        """Return a procedure, ready to travel."""
        return cls(name=name, text=text, sha256=_digest(text))

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        found = _digest(self.text)
        if found != self.sha256:
            raise ValueError(
                f"the text of {self.name} has the SHA-256 {found[:12]}..., "
                f"not {self.sha256[:12]}... as stated by its sender"
            )
        return self


class ProcedureName(Message):
    """A procedure that the daemon has."""

    name: FileWord


class Checked(Message):
    """A procedure with the values it is to have."""

    procedure: ProcedureFile
    set: Settings = Field(default_factory=dict)


class StartArguments(Checked):
    """A run to start."""

    seed: Annotated[int, Field(ge=0, lt=2**32)] | None = None
    answers: Literal["ask", "procedure"] = "ask"
    """Whether its prompts wait for a person, or take the procedure's own answers."""
    on_client_loss: Literal["continue", "finish_trial", "stop"] | None = None
    """The action when the client vanishes; None: as the procedure specifies."""
    note: Annotated[str, StringConstraints(max_length=MOST_NOTE_LETTERS)] = ""
    """A note, kept in the recording."""
    meta: Annotated[Settings, Field(max_length=MOST_ENTRIES)] = Field(default_factory=dict)
    """Names and values, kept in the recording, such as `batch: 13`."""
    specimen: Annotated[str, StringConstraints(pattern=f"^({SPECIMEN_NAME})?$")] = ""
    """The specimen in the rig."""

    @model_validator(mode="after")
    def _says_text(self) -> Self:
        About(note=self.note, meta=self.meta, specimen=self.specimen)
        return self


class Answered(Message):
    """The answer to a prompt."""

    prompt_id: Annotated[int, Field(ge=0)]
    value: Annotated[float, Field()] | Text | bool
    """A quantity in SI, a word or text, or whether it is confirmed."""


class InterlockName(Message):
    """The interlock that a person has looked at."""

    interlock: FileWord
    since_ns: Nanoseconds | None = None
    """The `since_ns` of the trip that was looked at, to 1 us: refused if there is a newer one.
    Without it, the newest counts as looked at.
    """


class RunArguments(Message):
    """A recording."""

    run: RunName


class CalibrateArguments(RunArguments):
    """The recording of a calibration, and for how many days its values may be used."""

    days: Annotated[int, Field(ge=1, le=36_500)] = 365
    write: bool = False
    """Whether the calibration file is renewed; else it is only shown what would be written."""


class ResumeRun(RunArguments):
    """A recording to go on with."""

    on_client_loss: Literal["continue", "finish_trial", "stop"] | None = None
    """The action when the client vanishes; None: as the procedure specifies."""


class Runs(Message):
    """Which recordings."""

    limit: Annotated[int, Field(ge=1, le=500)] = 100
    """How many, the newest first."""
    before: RunName | None = None
    """Only recordings older than this recording."""
    where: Annotated[str, StringConstraints(max_length=2000)] = ""
    """Only recordings for which this condition holds, as `rigd runs --where` takes it."""


class PieceArguments(Message):
    """A piece of a file."""

    run: RunName
    offset: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """In bytes."""
    length: Annotated[int, Field(ge=1, le=MAX_PIECE_BYTES)] = MAX_PIECE_BYTES
    """In bytes; the reply is shorter at the end of the file."""


class ComparedRuns(Message):
    """Recordings to compare, and a piece of the page."""

    runs: Annotated[tuple[RunName, ...], Field(min_length=2, max_length=MAX_COMPARED)]
    """Each is a campaign; differences are from the first."""
    offset: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """In bytes."""
    length: Annotated[int, Field(ge=1, le=MAX_PIECE_BYTES)] = MAX_PIECE_BYTES
    """In bytes; the reply is shorter at the end of the page."""


class ReportPiece(PieceArguments):
    """A piece of a page on a recording."""

    page: Literal["run", "identification"] = "identification"
    """The kind of page: of the recording, or of its analysis."""


class Since(Message):
    """Which events."""

    seq: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Those numbered from here."""


class StreamName(Message):
    """A stream of live data."""

    stream: Name


class Receiver(Message):
    """The client and user that the lease goes to."""

    to: Name
    user: User = ""
    """One of its users, who must have requested it; empty: the first requester, or the client
    itself.
    """


class ActArguments(Message):
    """An action of a device, such as a tare."""

    device: FileWord
    action: FileWord


class ReasonArguments(Message):
    """Why a person stops the rig; shown, and recorded."""

    reason: Annotated[
        str,
        BeforeValidator(lambda text: stop_reason(text) if isinstance(text, str) else text),
        StringConstraints(max_length=MAX_REASON),
    ] = ""
    """A longer one is cut; characters that control a terminal become spaces."""


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
