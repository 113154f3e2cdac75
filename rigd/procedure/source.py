"""Defines which keys and values a procedure file may contain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le
from pydantic import (
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    StringConstraints,
    Tag,
)
from pydantic_core import CoreSchema, core_schema

from rigd.config.schema import file_schema
from rigd.config.source import (
    ChannelName,
    DerivedSource,
    FileName,
    FilePath,
    GivenConstant,
    Name,
    QuantityText,
    SetpointName,
    Source,
)
from rigd.model.patterns import condition_schema
from rigd.procedure.profiles.profile_source import ProfileSource, Time

#: A quantity, or an expression such as `0.5 * ${current}`.
Expression = QuantityText
#: The same, which may also be any text.
Answer = Annotated[str, Field(json_schema_extra={"type": ["string", "number"]})]
#: `carriage.position > 1.15 m`
ConditionText = Annotated[str, Field(json_schema_extra=condition_schema())]
#: A plain value of an option: number, truth value, word.
OptionText = Annotated[str, Field(json_schema_extra={"type": ["string", "number", "boolean"]})]
#: Text in which `${name}` is replaced.
Template = Annotated[str, StringConstraints(min_length=1, max_length=2000)]
#: A step may have spaces in its name: only people read it.
StepName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][\w /.-]*$", max_length=60)]


#: The unit that a person reads.
UnitText = Annotated[str, StringConstraints(min_length=1, max_length=40)]
#: A parameter of a model in the notation of its field: `V_s`, `mu_c`.
ModelParameter = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]


@dataclass(frozen=True)
class OneOrMore:
    """Marks a list that may be written as its single item."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Wrap a single text, then check the list."""
        return core_schema.no_info_before_validator_function(_as_list, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Offer an editor both forms."""
        many = handler(schema)
        return {"anyOf": [many["items"], many]}


def _as_list(value: object) -> object:
    return [value] if isinstance(value, str) else value


class ParameterSource(Source):
    """A value that `--set NAME=VALUE` or the sweep sets."""

    doc: Annotated[str, StringConstraints(min_length=1, max_length=500)]
    """Its meaning, for the operator."""
    unit: str | None = None
    """Displayed unit; left out for a plain number or a word."""
    default: Expression | None = None
    """Value if `--set` and the sweep give none."""
    min: Expression | None = None
    """Smallest value allowed."""
    max: Expression | None = None
    """Largest value allowed."""
    choices: Annotated[list[Name], Field(min_length=1, max_length=64)] | None = None
    """The allowed words; without them, the parameter is a quantity."""


class TableSource(Source):
    """A quantity or word that follows from a parameter with choices."""

    by: Name
    """The parameter that selects the value."""
    values: Annotated[dict[Name, Answer], Field(min_length=1)]
    """One value for each choice."""
    doc: str | None = None
    """Its meaning, for the operator."""
    unit: str | None = None
    """Displayed unit; left out for plain numbers or words."""


class RangeSource(Source):
    """Evenly spaced values, both ends included."""

    start: Annotated[Expression, Field(alias="from")]
    """First value."""
    to: Expression
    """Last value; a whole number of steps after the first."""
    step: Expression
    """Distance of two values."""


def _axis_kind(value: object) -> str:
    return "range" if isinstance(value, dict) else "list"


#: Values of one parameter: a list, or `{from: ..., to: ..., step: ...}`.
Axis = Annotated[
    Annotated[list[Expression], Field(min_length=1, max_length=10_000), Tag("list")]
    | Annotated[RangeSource, Tag("range")],
    Discriminator(_axis_kind),
]


class SweepSource(Source):
    """The trials: every point of `grid`, each with every row of `zip`."""

    grid: dict[Name, Axis] = Field(default_factory=dict)
    """Values for each parameter, all combined; the first parameter changes slowest."""
    zip: dict[Name, Axis] = Field(default_factory=dict)
    """Values for each parameter, taken row by row; all of the same length."""
    order: Literal["given", "random"] = "given"
    """The order of play."""
    seed: Annotated[int, Ge(0), Le(2**31)] | None = None
    """Seed of a random order; the same seed gives the same order."""


def _setpoint_kind(value: object) -> str:
    return "profile" if isinstance(value, dict) else "value"


Setpoint = Annotated[
    Annotated[Expression, Tag("value")] | Annotated[ProfileSource, Tag("profile")],
    Discriminator(_setpoint_kind),
]
#: Words of a parameter with which a step plays: one word, or a list of words.
Words = Annotated[list[Name], Field(min_length=1), OneOrMore()]


class HoldSource(Source):
    """What a step does while a pause holds it; its time stands still."""

    set: dict[SetpointName, Expression] = Field(default_factory=dict)
    """Setpoints while it is held: a quantity, or `rest`; those not named keep the value that they
    have reached.
    """
    timeout: Time
    """Longest time that it may be held; then the trial ends at rest, marked incomplete."""


class MoveSource(Source):
    """A step that the cycle plays: setpoints, and its end."""

    model_config = ConfigDict(
        json_schema_extra={
            "anyOf": [{"required": ["for"]}, {"required": ["until", "timeout"]}],
            "errorMessage": "a step ends by 'for', or by 'until' with a 'timeout'",
        }
    )

    step: StepName
    """Name of the step, for the log."""
    when: dict[Name, Words] = Field(default_factory=dict)
    """The step plays only if each of these parameters is (one of) the given word(s)."""
    set: dict[SetpointName, Setpoint] = Field(default_factory=dict)
    """Setpoints as `device.setpoint`, or controllers by name; those not named keep their value."""
    until: Annotated[list[ConditionText], Field(min_length=1), OneOrMore()] | None = None
    """Ends the step: `carriage.position > 1.15 m`; any item of a list; `and` and `or` join
    conditions, `and` before `or`.
    """
    wait: Annotated[Time | None, Field(alias="for")] = None
    """Ends the step after this time."""
    timeout: Time | None = None
    """Longest time for `until`."""
    on_timeout: Literal["fail", "end_trial", "next"] = "fail"
    """Effect of running out of time; by default the procedure fails."""
    hold: HoldSource | None = None
    """A pause holds this step in its midst; without it, a pause waits for the end of the trial."""


class AgreesSource(Source):
    """The channel that must agree with the operator's answer."""

    channel: Annotated[ChannelName, Field(alias="with")]
    """The channel; if its device reports whether it is stable, it must be stable."""
    within: Expression
    """Largest difference from the answer: a share (`5 %`) or a quantity (`0.1 kg`)."""
    wait: Annotated[Time | None, Field(alias="for")] = None
    """How long it must agree without interruption; by default a single row is enough."""


class PromptSource(Source):
    """A step that waits for the operator."""

    prompt: Name
    """Name of the prompt, for the log and for answers given in advance."""
    when: dict[Name, Words] = Field(default_factory=dict)
    """The prompt is shown only if each of these parameters is (one of) the given word(s)."""
    text: Template
    """The text for the operator."""
    once_per: Annotated[list[Name], OneOrMore()] = Field(default_factory=list)
    """In a trial: shown only if one of these parameters differs from the previous trial."""
    answer: Answer | None = None
    """The procedure's own answer, used in simulation and with `--yes`."""
    unit: str | None = None
    """Asks for a quantity in this unit."""
    min: Expression | None = None
    """Smallest quantity accepted."""
    max: Expression | None = None
    """Largest quantity accepted."""
    choices: Annotated[list[Template], Field(min_length=1)] | None = None
    """Asks for one of these words."""
    free_text: bool = False
    """Asks for any text. Without `unit`, `choices` or this, the operator only confirms."""
    changes: Name | None = None
    """The setting of a simulated rig that changes to the answer: `floor`, `mass`."""
    agrees: AgreesSource | None = None
    """The channel that must agree with the answer before anything moves; else the prompt is
    repeated.
    """
    until: Annotated[list[ConditionText], Field(min_length=1), OneOrMore()] | None = None
    """The condition that must hold after the answer, before anything moves; written like the end of
    a step.
    """
    timeout: Time | None = None
    """Longest time for `agrees` and `until`; then the prompt is repeated."""


class ShownFaultSource(Source):
    """The fault of a simulated device, and its duration."""

    part: Name
    """The device or bus with the fault, by its name in the simulation."""
    fault: Name
    """Name of the fault: `docs/faults.md` lists those of every device."""
    after: Time | None = None
    """Delay after the step is reached; by default none."""
    lasting: Annotated[Time | None, Field(alias="for")] = None
    """Duration; by default until the run ends."""
    options: dict[Name, OptionText] = Field(default_factory=dict)
    """Options of the fault: numbers in SI, words."""


class FaultSource(Source):
    """A step in which a simulated device shows a fault; it takes no time itself."""

    fault: ShownFaultSource
    """The fault. Only for rigs with a `simulation:`."""
    when: dict[Name, Words] = Field(default_factory=dict)
    """The fault is shown only if each of these parameters is (one of) the given word(s)."""


def _step_kind(value: object) -> str:
    kinds = (kind for kind in ("prompt", "fault") if isinstance(value, dict) and kind in value)
    return next(kinds, "step")


StepSource = Annotated[
    Annotated[MoveSource, Tag("step")]
    | Annotated[PromptSource, Tag("prompt")]
    | Annotated[FaultSource, Tag("fault")],
    Discriminator(_step_kind),
]
Steps = Annotated[list[StepSource], Field(max_length=1000)]


class TrialLimitSource(Source):
    """Bounds of a channel while a trial plays."""

    low: Expression | None = None
    """The trial ends, marked incomplete, below this value."""
    high: Expression | None = None
    """The trial ends, marked incomplete, above this value."""


class TrialSource(Source):
    """The steps at each point of the sweep."""

    limits: dict[ChannelName, TrialLimitSource] = Field(default_factory=dict)
    """Bounds of channels while the steps play; beyond them the trial ends, marked incomplete."""
    steps: Annotated[list[StepSource], Field(min_length=1, max_length=1000)]
    """The measurement."""
    after: Steps = Field(default_factory=list)
    """Returns the rig to the start of the next trial; also plays if a trial ended early."""


class ReferenceSource(Source):
    """Published values to print beside the estimates."""

    label: Annotated[str, StringConstraints(min_length=1, max_length=80)]
    """Their source."""
    by: Name | None = None
    """The parameter with choices that selects the values to compare, if one does."""
    values: dict[Name, dict[ModelParameter, Expression]] = Field(default_factory=dict)
    """With `by`: for each choice, the value of each parameter of the model."""
    parameters: dict[ModelParameter, Expression] = Field(default_factory=dict)
    """Without `by`: the value of each parameter of the model."""


class IdentifySource(Source):
    """How `rigd identify` evaluates the recording."""

    model: FileName
    """Name of the model."""
    signals: dict[Name, ChannelName]
    """The channel of each signal of the model."""
    optional_signals: dict[Name, ChannelName] = Field(default_factory=dict)
    """Further signals of the model, used on a rig that has the channel and left out on others."""
    constants: dict[Name, GivenConstant] = Field(default_factory=dict)
    """Known quantities of the model: `50 mm`, `${rig.wheel_radius}`, or with an uncertainty
    `{value: "${mass}", u: 1 g}`; a constant of the rig brings its own uncertainty.
    """
    group_by: Annotated[list[Name], OneOrMore()] = Field(default_factory=list)
    """Parameters whose values separate identifications."""
    reference: ReferenceSource | None = None
    """Published values to print beside the estimates."""
    check: Literal["warn", "ask", "end"] | None = None
    """Evaluate each trial once it has ended. If it cannot be used: `warn` and go on, `ask` the
    operator whether to go on, or `end` the run. By default trials are not evaluated in a run."""


#: The part of a trial: `steady`, `last 2 s of steady`, `1 s to 3 s of steady`, `1 s to 3 s`.
WindowText = Annotated[str, StringConstraints(min_length=1, max_length=200)]


class PartSource(Source):
    """The part of a trial between two events, or that in which a condition holds."""

    since: Annotated[list[ConditionText], Field(min_length=1), OneOrMore()] | None = Field(
        default=None, alias="from"
    )
    """The condition that begins it; without one, the beginning of `of`."""
    to: Annotated[list[ConditionText], Field(min_length=1), OneOrMore()] | None = None
    """The condition that ends it, after the first one; without one, the end of `of`."""
    nth: Annotated[int, Ge(1), Le(100_000)] = 1
    """How often `from` has begun to hold then."""
    holds: Annotated[list[ConditionText], Field(min_length=1), OneOrMore()] | None = Field(
        default=None, alias="while"
    )
    """Only samples while this condition holds."""
    of: WindowText | None = None
    """The part of the trial in which this is sought; without it, all steps of the trial."""


def _during_kind(value: object) -> str:
    return "part" if isinstance(value, dict | PartSource) else "window"


#: `last 2 s of steady`, or `{from: joint.speed > 0 rad/s, to: joint.speed < 0 rad/s}`.
During = Annotated[
    Annotated[WindowText, Tag("window")] | Annotated[PartSource, Tag("part")],
    Discriminator(_during_kind),
]


class DurationSource(Source):
    """A time between two events."""

    since: Annotated[list[ConditionText], Field(min_length=1), OneOrMore()] | None = Field(
        default=None, alias="from"
    )
    """The condition that begins it; without one, the beginning of `during`."""
    to: Annotated[list[ConditionText], Field(min_length=1), OneOrMore()]
    """The condition that ends it, after the first one."""


class MeasureSource(Source):
    """A quantity that is read off each trial: exactly one of `channel`, `mean`, `max`, ..."""

    channel: ChannelName | None = None
    """Its value at the moment at which `when` begins to hold."""
    when: Annotated[list[ConditionText], Field(min_length=1), OneOrMore()] | None = None
    """With `channel`: the condition; the first time that it begins to hold counts."""
    mean: ChannelName | None = None
    """The mean of this channel."""
    max: ChannelName | None = None
    """Its largest value."""
    min: ChannelName | None = None
    """Its smallest value."""
    peak_to_peak: ChannelName | None = None
    """Its largest value less its smallest."""
    rms: ChannelName | None = None
    """The root of the mean of its squares."""
    std: ChannelName | None = None
    """Its standard deviation about its mean."""
    slope: ChannelName | None = None
    """The slope of the straight line through it, per second."""
    final: ChannelName | None = None
    """Its last value."""
    duration: DurationSource | None = None
    """The time between two events, in s."""
    during: During | None = None
    """The part of the trial: a step, or `last 2 s of STEP`, `first 2 s of STEP`, `1 s to 3 s of
    STEP`, without `of STEP` of the trial; or `{from: CONDITION, to: CONDITION, nth: 3, while:
    CONDITION, of: STEP}`. Without it, all steps of the trial.
    """
    unit: UnitText | None = None
    """How people read it; by default the SI unit."""
    u: Expression | None = None
    """Standard uncertainty (k = 1) of what measures it, the same in all trials, such as that of a
    calibration: `0.5 %` of the value, or a difference. It does not become smaller by repeats.
    """
    doc: Annotated[str, StringConstraints(max_length=400)] = ""
    """What it is."""


class BoundsSource(Source):
    """What a result must be: at least `min`, at most `max`."""

    min: Expression | None = None
    """Smallest value that is right."""
    max: Expression | None = None
    """Largest value that is right."""


def _accept_kind(value: object) -> str:
    return "bounds" if isinstance(value, dict) else "interval"


#: `[0.10, 0.14]`, or `{min: 0.1}`.
Accepted = Annotated[
    Annotated[list[Expression], Field(min_length=2, max_length=2), Tag("interval")]
    | Annotated[BoundsSource, Tag("bounds")],
    Discriminator(_accept_kind),
]


#: "Every n-th row".
Every = Annotated[int, Ge(1), Le(1_000_000)]


class WindowSource(Source):
    """The recorded part of a stream, and the steps during which it is recorded."""

    every: Every = 1
    """Every n-th row (1: all)."""
    during: Annotated[list[StepName], Field(min_length=1), OneOrMore()]
    """The steps during which it is recorded."""


class CaptureSource(Source):
    """The recorded part of a stream, and what must hold for it to be recorded."""

    every: Every = 1
    """Every n-th row (1: all)."""
    when: Annotated[list[ConditionText], Field(min_length=1), OneOrMore()]
    """The condition, written like the end of a step; with several, any."""
    before: Time
    """How long before it holds the recording begins."""
    after: Time
    """How long after it has held last the recording ends."""


def _stream_kind(value: object) -> str:
    if not isinstance(value, dict):
        return "every"
    return "capture" if {"when", "before", "after"} & value.keys() else "window"


def _record_kind(value: object) -> Any:
    return "all" if isinstance(value, str) else "streams"


#: Every n-th row, `{every: n, during: [step, ...]}` or `{when: condition, before: s, after: s}`.
StreamRecord = Annotated[
    Annotated[Every, Tag("every")]
    | Annotated[WindowSource, Tag("window")]
    | Annotated[CaptureSource, Tag("capture")],
    Discriminator(_stream_kind),
]
Record = Annotated[
    Annotated[Literal["all"], Tag("all")]
    | Annotated[dict[Name, StreamRecord], Field(min_length=1), Tag("streams")],
    Discriminator(_record_kind),
]


class ProcedureSource(Source):
    """A procedure: what it varies, does and records."""

    procedure: FileName
    """Name of the procedure."""
    title: Annotated[str, StringConstraints(min_length=1, max_length=200)]
    """A title in one line."""
    doc: Annotated[str, StringConstraints(min_length=1, max_length=10_000)]
    """Its purpose and source."""
    try_on: FilePath | None = None
    """Simulated rig on which it plays if no rig is given: a file, or a name, such as lugre-1."""
    parameters: dict[Name, ParameterSource] = Field(default_factory=dict)
    """Values that may change from run to run, or from trial to trial."""
    tables: dict[Name, TableSource] = Field(default_factory=dict)
    """Values that follow from a parameter with choices."""
    sweep: SweepSource = SweepSource()
    """The trials; without a sweep there is one trial."""
    repeats: Annotated[int, Ge(1), Le(1000)] = 1
    """How often each point of the sweep is played."""
    derived: dict[ChannelName, DerivedSource] = Field(default_factory=dict, max_length=64)
    """Channels computed in every cycle of the run from others, by name, as `group.channel`."""
    prepare: Steps = Field(default_factory=list)
    """Steps before the first trial, once."""
    trial: TrialSource
    """Steps at each point of the sweep."""
    finish: Steps = Field(default_factory=list)
    """Steps after the last trial or a controlled stop, once; never after an abort or a fault."""
    record: Record = "all"
    """`all`, or for each stream "every n-th row" (1: all), with or without the steps during which
    it is recorded; streams not named are not recorded.
    """
    measure: dict[Name, MeasureSource] = Field(default_factory=dict, max_length=64)
    """What is read off each trial, by name: `{mu: {mean: friction.mu, during: steady}}`."""
    accept: dict[Name, Accepted] = Field(default_factory=dict)
    """What measures must be, by name: `{mu: [0.10, 0.14]}`."""
    identify: IdentifySource | None = None
    """The analysis of the recording."""
    on_client_loss: Literal["continue", "finish_trial", "stop"] = "stop"
    """The action of the run when the client that steers it remotely vanishes: continue, stop after
    the present trial, or stop at once (controlled, `finish` plays).
    """


def procedure_schema() -> dict[str, Any]:
    """Return the JSON Schema of procedure files, with which an editor checks a file."""
    return file_schema(ProcedureSource, "rigd procedure file")
