"""Defines the messages of the panel: the requests of the page, and what the page receives.

Data from the rig are messages of the remote protocol. The page cannot compute with units. If the
page shows or sends a quantity in a unit of its own, the message has that unit as numbers too
(:class:`UnitScale`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, JsonValue, StringConstraints
from pydantic.json_schema import models_json_schema

from rigd.model.poses import poses_of
from rigd.model.units import parse_unit
from rigd.remote.protocol import VERBS, Kind, Message, RigEvent, Status, Verb
from rigd.remote.protocol.results import (
    ChannelView,
    Description,
    DryRun,
    LatestValues,
    ParameterView,
    PeakView,
    ProcedureView,
    RunLine,
    RunView,
    StreamView,
)
from rigd.remote.protocol.status import PromptView, TrialStatus

Role = Literal["operator", "observer"]

#: Questions of the page to the rig; files have routes of their own.
ASKS: Mapping[str, Verb] = {
    name: VERBS[Kind.ASK][name]
    for name in (
        "describe", "procedures", "procedure", "check", "runs", "run", "events", "latest",
        "compare",
    )
}  # fmt: skip
#: Commands of the page; the panel renews the lease itself.
COMMANDS: Mapping[str, Verb] = {
    name: verb for name, verb in VERBS[Kind.COMMAND].items() if name != "lease_renew"
}


class Login(Message):
    """A one-time code, and the name of the person who uses it."""

    code: Annotated[str, StringConstraints(max_length=200)]
    name: Annotated[str, StringConstraints(max_length=40)]


class InvitationRequest(Message):
    """A request for a one-time code."""

    role: Role


class VerbRequest(Message):
    """The arguments of a verb."""

    args: dict[str, JsonValue] = Field(default_factory=dict)


class StopRequest(Message):
    """A stop on the WebSocket for stops."""

    number: int
    """The reply has the same number."""
    verb: str


class SessionView(Message):
    """The session of a page."""

    name: str
    """The name of its user, which no other session has."""
    role: Role
    identity: str
    """The name under which the daemon knows the panel."""


class SessionReply(Message):
    """The session of the page that asks."""

    rig: str
    """The name of its rig."""
    session: SessionView | None


class Invitation(Message):
    """A one-time code for another screen."""

    code: str


class RequestError(Message):
    """The reason why a request failed."""

    code: str
    message: str
    hint: str | None = None


class UnitScale(Message):
    """A unit as numbers: SI value = `factor` times the number in the unit + `offset`."""

    factor: float
    offset: float


class PagePrompt(PromptView):
    """A prompt with its unit as numbers."""

    factor: float
    """What a difference of 1 in `unit` is in SI."""
    offset: float
    """What 0 in `unit` is in SI; 0 but for degC and the like."""


class PageTrial(TrialStatus):
    """The trial under way."""

    scales: dict[str, UnitScale]
    """The units of its parameters, as numbers."""


class PageStatus(Status):
    """The status of the rig."""

    prompt: PagePrompt | None = None
    trial: PageTrial | None = None

    @classmethod
    def of(cls, status: Status) -> PageStatus:
        """Return ``status`` with the units of its prompt and its trial as numbers."""
        prompt, trial = status.prompt, status.trial
        if prompt is not None:
            prompt = PagePrompt(**{**dict(prompt), **_scale(prompt.unit)})
        if trial is not None:
            trial = PageTrial(**dict(trial), scales=_scales(trial.units))
        return cls(**{**dict(status), "prompt": prompt, "trial": trial})


class PageEvent(RigEvent):
    """An event of the rig."""

    scales: dict[str, UnitScale] = Field(default_factory=dict)
    """The units of the parameters of a trial that starts, as numbers."""

    @classmethod
    def of(cls, event: RigEvent) -> PageEvent:
        """Return ``event`` with the units of its parameters as numbers."""
        units = event.data.get("units") if event.kind == "trial_start" else None
        return cls(**dict(event), scales=_scales(units) if isinstance(units, dict) else {})


class PageParameter(ParameterView):
    """A parameter of a procedure with its unit as numbers."""

    factor: float
    """What a difference of 1 in `unit` is in SI."""
    offset: float
    """What 0 in `unit` is in SI; 0 but for degC and the like."""


class PageProcedure(ProcedureView):
    """A procedure."""

    parameters: tuple[PageParameter, ...]

    @classmethod
    def of(cls, view: ProcedureView) -> PageProcedure:
        """Return ``view`` with the units of its parameters as numbers."""
        parameters = tuple(
            PageParameter(**{**dict(item), **_scale(item.unit)}) for item in view.parameters
        )
        return cls(**{**dict(view), "parameters": parameters})


class RecordedTrial(Message):
    """A trial of a recording."""

    number: int
    parameters: dict[str, float | str | bool]
    """Quantities in SI."""
    units: dict[str, str]
    scales: dict[str, UnitScale]
    """Their units as numbers."""


class PageRun(Message):
    """A recording, and the values that were set for its run."""

    line: RunLine
    parameters: dict[str, JsonValue]
    """The values that were set for the whole run."""
    last_trial: RecordedTrial | None
    """The last trial that began."""

    @classmethod
    def of(cls, view: RunView) -> PageRun:
        """Return the part of ``view`` that the page shows."""
        details: Mapping[str, Any] = view.details
        trials = details.get("trials", ())
        last = None
        if trials:
            found = trials[-1]
            units = found.get("units", {})
            last = RecordedTrial(
                number=found["number"],
                parameters=found["parameters"],
                units=units,
                scales=_scales(units),
            )
        return cls(line=view.line, parameters=details.get("parameters", {}), last_trial=last)


class RigLink(Message):
    """The connection of the panel to the rig."""

    alive: bool
    silent_s: float | None
    """Time since the last status; None if there was no status."""


class PagePose(Message):
    """A body in a plane (:class:`rigd.model.poses.Pose`), by places in its stream."""

    body: str
    stream: int
    """The number of the stream."""
    x: int
    y: int
    heading: int | None
    """None if it is not measured."""
    watched: bool
    """Whether an interlock watches the stream."""


class PageChannel(ChannelView):
    """A channel; `display` is never empty."""

    factor: float
    """What a difference of 1 in `display` is in SI."""
    offset: float
    """What 0 in `display` is in SI; 0 but for degC and the like."""

    @classmethod
    def of(cls, view: ChannelView) -> PageChannel:
        """Return ``view`` with the unit in which people read it as numbers."""
        return cls(**{**dict(view), **_displayed(view)})


class PageStream(StreamView):
    """A stream of live data."""

    channels: tuple[PageChannel, ...]


class PagePeak(PeakView):
    """The predicted extremes of a channel; `display` is never empty."""

    factor: float
    """What a difference of 1 in `display` is in SI."""
    offset: float
    """What 0 in `display` is in SI; 0 but for degC and the like."""


class PageDryRun(DryRun):
    """The result of a dry run."""

    peaks: tuple[PagePeak, ...]

    @classmethod
    def of(cls, found: DryRun) -> PageDryRun:
        """Return ``found`` with the units in which people read the channels as numbers."""
        peaks = tuple(PagePeak(**{**dict(item), **_displayed(item)}) for item in found.peaks)
        return cls(**{**dict(found), "peaks": peaks})


class PageDescription(Description):
    """The description of the rig with the poses that the page draws in a plane."""

    streams: tuple[PageStream, ...]
    poses: tuple[PagePose, ...] = ()

    @classmethod
    def of(cls, description: Description) -> PageDescription:
        """Return ``description`` with its poses."""
        streams = {stream.name: stream for stream in description.streams}
        watched = {item.source.partition(".")[0] for item in description.interlocks}
        poses = []
        for pose in poses_of(description.streams):
            stream = streams[pose.stream]
            place = {channel.name: at for at, channel in enumerate(stream.channels)}
            poses.append(
                PagePose(
                    body=pose.body,
                    stream=stream.number,
                    x=place[pose.x],
                    y=place[pose.y],
                    heading=None if pose.heading is None else place[pose.heading],
                    watched=pose.stream in watched,
                )
            )
        shown = tuple(
            PageStream(
                **{**dict(item), "channels": tuple(map(PageChannel.of, item.channels))},
            )
            for item in description.streams
        )
        return cls(**{**dict(description), "streams": shown}, poses=tuple(poses))


class LiveStatus(Message):
    """The status, at every change and twice a second."""

    kind: Literal["status"] = "status"
    status: PageStatus


class LiveDescription(Message):
    """The description of the rig, when the page opens and after a restart of the daemon."""

    kind: Literal["describe"] = "describe"
    describe: PageDescription


class LiveLatest(Message):
    """The latest values, while no run plays."""

    kind: Literal["latest"] = "latest"
    latest: LatestValues


class LiveLink(Message):
    """The connection to the rig, twice a second."""

    kind: Literal["panel"] = "panel"
    panel: RigLink


class LiveEvent(Message):
    """An event."""

    kind: Literal["event"] = "event"
    event: PageEvent


class LiveSkipped(Message):
    """The number of events that were left out, as the browser was too slow."""

    kind: Literal["skipped"] = "skipped"
    skipped: Annotated[int, Field(gt=0)]


#: For each of these kinds only the newest message matters.
LiveState = LiveStatus | LiveDescription | LiveLatest | LiveLink
LiveMessage = LiveState | LiveEvent | LiveSkipped

#: What the page receives instead of a message of the protocol.
_COMPLETED: Mapping[type[Message], type[Message]] = {
    Description: PageDescription,
    DryRun: PageDryRun,
    ProcedureView: PageProcedure,
    RunView: PageRun,
}


def complete(answer: Message) -> Message:
    """Return the answer to a question or command, with the additional data for the page."""
    match answer:
        case Description():
            return PageDescription.of(answer)
        case DryRun():
            return PageDryRun.of(answer)
        case ProcedureView():
            return PageProcedure.of(answer)
        case RunView():
            return PageRun.of(answer)
    return answer


def page_schema() -> dict[str, Any]:
    """Return the JSON Schema of all messages, and under ``x-*`` the types of each request."""
    asks = {
        name: (verb.arguments, _COMPLETED.get(verb.result, verb.result))
        for name, verb in ASKS.items()
    }
    commands = {
        name: (verb.arguments, _COMPLETED.get(verb.result, verb.result))
        for name, verb in COMMANDS.items()
    }
    stop = next(iter(VERBS[Kind.STOP].values())).result
    own: list[type[Message]] = [
        SessionReply, Invitation, RequestError, stop,
        LiveStatus, LiveDescription, LiveLatest, LiveLink, LiveEvent, LiveSkipped,
    ]  # fmt: skip
    results = [*own, *(result for table in (asks, commands) for _, result in table.values())]
    arguments = [args for table in (asks, commands) for args, _ in table.values()]
    both: list[Any] = [(kind, "serialization") for kind in dict.fromkeys(results)]
    both += [(kind, "validation") for kind in dict.fromkeys(arguments)]
    references, schema = models_json_schema(both)
    return {
        "$defs": schema["$defs"],
        **{
            f"x-{title}": {
                name: {
                    "args": references[args, "validation"],
                    "result": references[result, "serialization"],
                }
                for name, (args, result) in table.items()
            }
            for title, table in (("asks", asks), ("commands", commands))
        },
    }


def _displayed(view: ChannelView | PeakView) -> dict[str, str | float]:
    symbol = view.display or view.unit
    return {"display": symbol, **_scale(symbol)}


def _scale(symbol: str) -> dict[str, float]:
    unit = parse_unit(symbol)
    return {"factor": unit.factor, "offset": unit.offset}


def _scales(units: Mapping[str, Any]) -> dict[str, UnitScale]:
    return {name: UnitScale(**_scale(str(unit))) for name, unit in units.items()}
