"""Defines the results of requests: one model for each result that has fields of its own.

A missing bound is None, because JSON has no infinity.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Base64Bytes, Field, StringConstraints

from rigd.remote.protocol.arguments import FileWord, ProcedureFile, RunName, Sha256
from rigd.remote.protocol.limits import (
    HEARTBEAT_S,
    LEASE_S,
    LIVE_HZ,
    MAX_MESSAGE_BYTES,
    MAX_PIECE_BYTES,
    MAX_REQUEST_BYTES,
    RENEW_S,
)
from rigd.remote.protocol.message import DaemonData, DaemonText, Message, Name
from rigd.remote.protocol.roles import Role
from rigd.remote.protocol.status import ActionName, Count, Nanoseconds, RigEvent

#: How urgently a person must look (:class:`rigd.model.limits.Priority`).
PriorityName = Literal["low", "medium", "high", "critical"]


class ChannelView(Message):
    """A channel of a stream."""

    name: DaemonText
    unit: DaemonText
    """SI; values come in it."""
    display: DaemonText = ""
    """The unit in which people read them, "" for `unit`."""
    doc: DaemonText = ""
    low: float | None = None
    """The range that the device can measure."""
    high: float | None = None
    raw_of: DaemonText | None = None


class StreamView(Message):
    """A stream of live data."""

    number: Count
    """As in its frames."""
    name: Name
    channels: tuple[ChannelView, ...]
    rate_hz: float


class SetpointView(Message):
    """A setpoint with the limits of the rig file."""

    name: DaemonText
    """`device.setpoint`."""
    unit: DaemonText
    low: float
    high: float
    rate: float | None = None
    """Per second."""
    rest: float = 0.0


class ControllerView(Message):
    """A controller; its stream has the measured value, the setpoint, `saturated` and `active`."""

    setpoint: DaemonText
    """`controller.channel`: the measured value; with `_setpoint` behind it, the setpoint."""
    output: DaemonText
    """The setpoint that it commands."""


class InterlockView(Message):
    """An interlock as the rig file has it; a bound is a value in SI or the name of a channel."""

    name: DaemonText
    source: DaemonText
    low: float | str | None = None
    high: float | str | None = None
    action: ActionName
    priority: PriorityName
    latch: bool
    message: DaemonText


class ActionView(Message):
    """An action that `act` can ask of a device."""

    device: FileWord
    action: FileWord
    doc: DaemonText = ""


class Sizes(Message):
    """The limits that this daemon keeps to."""

    request_bytes: int = MAX_REQUEST_BYTES
    message_bytes: int = MAX_MESSAGE_BYTES
    piece_bytes: int = MAX_PIECE_BYTES
    live_hz: float = LIVE_HZ
    heartbeat_s: float = HEARTBEAT_S
    lease_s: float = LEASE_S
    renew_s: float = RENEW_S


class StatedView(Message):
    """A field that the lab knows, which a person states when a run starts."""

    name: DaemonText
    """`specimen`, `note` or `meta.NAME`."""
    doc: DaemonText = ""
    required: bool = False
    """Whether a run without it is refused."""
    unit: DaemonText = ""
    """Of a quantity; another unit of its kind may be given."""
    choices: tuple[DaemonText, ...] = ()


class Description(Message):
    """`describe`: what does not change while the daemon runs, but for the streams of a run."""

    rig: Name
    title: DaemonText
    simulated: bool
    streams: tuple[StreamView, ...]
    """Those of the rig, then those that only the present or the last run has: derived channels of
    its procedure. If these change, the daemon sends the event `streams`: ask again.
    """
    setpoints: tuple[SetpointView, ...] = ()
    interlocks: tuple[InterlockView, ...] = ()
    controllers: tuple[ControllerView, ...] = ()
    actions: tuple[ActionView, ...] = ()
    role: Role
    """Of the client that asked."""
    roles: dict[Name, Role] = Field(default_factory=dict)
    sizes: Sizes = Sizes()
    stated: tuple[StatedView, ...] = ()
    """What the lab demands of the start of a run; the daemon knows the operator."""


class ProcedureLine(Message):
    """A procedure of the daemon."""

    name: FileWord
    title: DaemonText = ""
    sha256: Sha256 | None = None
    """None if the file is wrong."""
    problem: DaemonText | None = None
    """Why it cannot run on this rig."""


class Procedures(Message):
    """`procedures`."""

    procedures: tuple[ProcedureLine, ...]


class ParameterView(Message):
    """A parameter of a procedure: a word if it has choices, else a quantity."""

    name: FileWord
    doc: DaemonText
    unit: DaemonText = "1"
    """In which people read it."""
    choices: tuple[DaemonText, ...] = ()
    default: DaemonText | None = None
    """As the author wrote it; None: the sweep gives it, or a person must."""
    min: DaemonText | None = None
    max: DaemonText | None = None
    swept: bool = False
    """Whether the sweep gives it; a value set by hand takes the place of the sweep."""


class ProcedureView(Message):
    """`procedure`: its file, and the data for its form."""

    procedure: ProcedureFile
    title: DaemonText
    doc: DaemonText
    parameters: tuple[ParameterView, ...]
    on_client_loss: Literal["continue", "finish_trial", "stop"]


class ProblemView(Message):
    """A problem of a procedure and its place; line and column count from 1."""

    message: DaemonText
    hint: DaemonText | None = None
    line: int | None = None
    column: int | None = None


class CheckReport(Message):
    """`check`: whether a procedure can run with these values."""

    ok: bool
    problems: tuple[ProblemView, ...] = ()
    trials: Count = 0
    prompts: Count = 0


class StepView(Message):
    """A step of a dry run, over all trials."""

    block: Literal["prepare", "trial", "after", "finish"]
    name: DaemonText
    setpoints: tuple[DaemonText, ...] = ()
    """A line each; values that the sweep varies are given as a range."""
    ends: tuple[DaemonText, ...] = ()
    """The end conditions, a line each."""
    played: Count
    shortest_s: float
    longest_s: float
    timing: Literal["played", "known", "at_most"] = "played"
    """Played on physics; or without physics known from the procedure, or only from a timeout."""


class PeakView(Message):
    """The predicted extremes of a channel beside its limits, in SI."""

    channel: DaemonText
    unit: DaemonText
    display: DaemonText = ""
    """As in :class:`ChannelView`."""
    lowest: float | None
    highest: float | None
    low: float | None
    high: float | None
    limit_by: DaemonText
    inside: bool


class DifferenceView(Message):
    """Something that the files of a rig and of its sibling state differently."""

    what: DaemonText
    here: DaemonText
    """In the rig file."""
    there: DaemonText
    """In the file of the sibling."""


class DryRun(Message):
    """`dry_run`."""

    ok: bool
    physics: Literal["plant", "sibling", "none"] = "plant"
    """What it was played on; with `none` nothing was, and there are no peaks."""
    sibling: DaemonText = ""
    """The simulated sibling that was played."""
    duration_s: float
    """Without physics the longest that all steps can take."""
    known_s: float | None = None
    """Without physics, the time of the steps with a known duration."""
    trials: Count
    steps: tuple[StepView, ...] = ()
    peaks: tuple[PeakView, ...] = ()
    refusals: tuple[DaemonText, ...] = ()
    differences: tuple[DifferenceView, ...] = ()
    notes: tuple[DaemonText, ...] = ()
    """What a reader must know of this dry run, in sentences."""


class RunLine(Message):
    """A recording."""

    run: RunName
    procedure: DaemonText
    state: DaemonText
    """How it ended."""
    started_ns: Nanoseconds
    """When it began, by the calendar; of a run in virtual time, when its file was made."""
    duration_s: float | None
    """How long it took; None if it ended before the rig was armed."""
    trials_done: Count
    trials_total: Count
    size: Count
    """In bytes."""
    has_report: bool
    """Whether the page of its identification is there."""
    has_page: bool
    """Whether the page of the run is there, and as new as the recording."""
    identifies: bool
    """Whether its procedure has an analysis."""
    calibrates: bool = False
    """Whether this analysis measures calibrated values, which `calibrate` writes."""
    set: DaemonText = ""
    """The values given at its start: `floor=pvc, load=2 N`."""
    specimen: DaemonText = ""
    condition: DaemonText = ""
    """`valid` if another program wrote it, `damaged`; empty if rigd wrote it: it is not checked."""
    problem: DaemonText | None = None
    """Why it cannot be read."""


class RunList(Message):
    """`runs`: the newest first."""

    runs: tuple[RunLine, ...]
    more: bool
    """Whether there are older recordings."""


class RunView(Message):
    """`run`."""

    line: RunLine
    details: DaemonData = Field(default_factory=dict)
    """The result of `rigd info --json`."""


class PieceView(Message):
    """`fetch`, `report` and `compare`: a piece of a file."""

    size: Count
    """Of the whole file, in bytes."""
    sha256: Sha256
    """Of the whole file."""
    offset: Count
    data: Annotated[Base64Bytes, Field(max_length=MAX_PIECE_BYTES)]
    """Base64 in JSON and when made, bytes when read."""


class Events(Message):
    """`events`: from the number asked for, or from the oldest still known."""

    events: tuple[RigEvent, ...]
    next: Count
    """The number to ask from next."""


class LatestReply(Message):
    """The latest value of a channel."""

    value: float | None
    """In SI; None: not a number."""
    age_s: float


class LatestValues(Message):
    """`latest`: by `device.channel`."""

    t_ns: Nanoseconds
    values: dict[Annotated[str, StringConstraints(max_length=130)], LatestReply]


class History(Message):
    """`history`: the last ten seconds of a stream."""

    frame: Annotated[Base64Bytes, Field(max_length=MAX_PIECE_BYTES)] | None
    """As those of its live data, reduced, its sequence that of the frame published last; None: no
    row came yet. Base64 in JSON and when made, bytes when read."""


class Started(Message):
    """`start` and `resume_run`."""

    run: RunName | None
    """The recording; None if its name is not yet known."""


class Reported(Message):
    """`identify` and `draw`: the page, which `report` then gives."""

    run: RunName
    size: Count


class RenewedValue(Message):
    """A calibrated value, new beside old."""

    name: DaemonText
    unit: DaemonText
    new: DaemonText
    """Value ± standard uncertainty (k = 1), in `unit`."""
    old: DaemonText
    """The same of the value that it replaces; empty if there is none."""
    deviation: float | None
    """(new - old)/u; None without an old value."""


class RenewedCalibration(Message):
    """`calibrate`."""

    file: DaemonText
    """The name of the calibration file."""
    values: tuple[RenewedValue, ...]
    operator: DaemonText
    valid_until: DaemonText
    """The last day, such as `2027-11-21`."""
    remarks: tuple[DaemonText, ...]
    """What a person must know before it is written."""
    written: bool


class ActionReply(Message):
    """`act`."""

    said: DaemonText
    """The reply of the device."""


class Stopped(Message):
    """`stop`, `abort` and `estop`."""

    acted: bool
    """Whether there was anything to stop that had not been stopped as hard before."""


class Nothing(Message):
    """Of commands that are done once they are answered."""
