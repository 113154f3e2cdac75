"""Schema of a procedure file: the keys and values that are allowed."""

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

from rigd.config.source import ChannelName, FileName, Name, QuantityText, Source
from rigd.model.patterns import condition_schema
from rigd.procedure.profile_source import ProfileSource, Time

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
#: A step may have blanks in its name: it is read by people only.
StepName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][\w /.-]*$", max_length=60)]


#: A parameter of a model as its field writes it: `V_s`, `mu_c`.
ModelParameter = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]


@dataclass(frozen=True)
class OneOrMore:
    """Marks a list that may be written as its only item."""

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
    """A value that `--set NAME=VALUE` or the sweep decides."""

    doc: Annotated[str, StringConstraints(min_length=1, max_length=500)]
    """What it is, for the person at the rig."""
    unit: str | None = None
    """Unit that people read it in; left out for a plain number or a word."""
    default: Expression | None = None
    """Value where nothing else gives one."""
    min: Expression | None = None
    """Smallest value allowed."""
    max: Expression | None = None
    """Largest value allowed."""
    choices: Annotated[list[Name], Field(min_length=1, max_length=64)] | None = None
    """The words it may be; without, it is a quantity."""


class TableSource(Source):
    """A quantity or word that follows from a parameter with choices."""

    by: Name
    """The parameter that decides."""
    values: Annotated[dict[Name, Answer], Field(min_length=1)]
    """One value for each choice."""
    doc: str | None = None
    """What it is, for the person at the rig."""
    unit: str | None = None
    """Unit that people read it in; left out for plain numbers or words."""


class RangeSource(Source):
    """Evenly spaced values, both ends included."""

    start: Annotated[Expression, Field(alias="from")]
    """First value."""
    to: Expression
    """Last value; a whole number of steps from the first."""
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
    """Decides a random order; the same seed gives the same order."""


def _setpoint_kind(value: object) -> str:
    return "profile" if isinstance(value, dict) else "value"


Setpoint = Annotated[
    Annotated[Expression, Tag("value")] | Annotated[ProfileSource, Tag("profile")],
    Discriminator(_setpoint_kind),
]
#: Words a parameter may be for a step to play: one, or a list of them.
Words = Annotated[list[Name], Field(min_length=1), OneOrMore()]


class MoveSource(Source):
    """A step that the cycle plays: setpoints, and what ends it."""

    model_config = ConfigDict(
        json_schema_extra={
            "anyOf": [{"required": ["for"]}, {"required": ["until", "timeout"]}],
            "errorMessage": "a step ends by 'for', or by 'until' with a 'timeout'",
        }
    )

    step: StepName
    """Name of the step, for the log."""
    when: dict[Name, Words] = Field(default_factory=dict)
    """The step plays only where each of these parameters is (one of) the word(s) given."""
    set: dict[ChannelName, Setpoint] = Field(default_factory=dict)
    """Setpoints as `device.setpoint`; those not named keep their value."""
    until: Annotated[list[ConditionText], Field(min_length=1), OneOrMore()] | None = None
    """Ends the step: `carriage.position > 1.15 m`; any of a list; `and` joins within one."""
    wait: Annotated[Time | None, Field(alias="for")] = None
    """Ends the step after this time."""
    timeout: Time | None = None
    """Longest time that `until` may take."""
    on_timeout: Literal["fail", "end_trial", "next"] = "fail"
    """What running out of time means; by default the procedure has failed."""


class AgreesSource(Source):
    """What must show the quantity that a person gave as answer."""

    channel: Annotated[ChannelName, Field(alias="with")]
    """The channel that shows it; where its device says whether it is stable, it must be."""
    within: Expression
    """How far it may be from the answer: a share (`5 %`) or a quantity (`0.1 kg`)."""
    wait: Annotated[Time | None, Field(alias="for")] = None
    """How long it must stand there without a break; by default one look is enough."""


class PromptSource(Source):
    """A step that waits for a person."""

    prompt: Name
    """Name of the prompt, for the log and for answers given beforehand."""
    when: dict[Name, Words] = Field(default_factory=dict)
    """The prompt is shown only where each of these parameters is (one of) the word(s) given."""
    text: Template
    """What the person reads."""
    once_per: Annotated[list[Name], OneOrMore()] = Field(default_factory=list)
    """In a trial: shown only where one of these parameters differs from the trial before."""
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
    """Asks for any text. Without `unit`, `choices` or this, the person only confirms."""
    changes: Name | None = None
    """What a simulated rig changes to the answer: `floor`, `mass`."""
    agrees: AgreesSource | None = None
    """What must show the answer before anything moves; else the person is asked again."""
    until: Annotated[list[ConditionText], Field(min_length=1), OneOrMore()] | None = None
    """What must hold, once answered, before anything moves; written as the end of a step."""
    timeout: Time | None = None
    """Longest time that `agrees` and `until` may take; then the person is asked again."""


class ShownFaultSource(Source):
    """What a simulated device gets wrong, and for how long."""

    part: Name
    """The device or bus that shows it, as the simulation calls it."""
    fault: Name
    """Name of the fault: `docs/faults.md` lists those of every device."""
    after: Time | None = None
    """How long after the step is reached it begins; by default at once."""
    lasting: Annotated[Time | None, Field(alias="for")] = None
    """How long it lasts; by default until the run ends."""
    options: dict[Name, OptionText] = Field(default_factory=dict)
    """Options of the fault: numbers in SI, words."""


class FaultSource(Source):
    """A step that lets a simulated device show a fault; it takes no time itself."""

    fault: ShownFaultSource
    """What is shown. Only for rigs with a `simulation:`."""
    when: dict[Name, Words] = Field(default_factory=dict)
    """It is shown only where each of these parameters is (one of) the word(s) given."""


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
    """What is done at each point of the sweep."""

    limits: dict[ChannelName, TrialLimitSource] = Field(default_factory=dict)
    """Bounds of channels while the steps play; beyond them the trial ends, marked incomplete."""
    steps: Annotated[list[StepSource], Field(min_length=1, max_length=1000)]
    """The measurement."""
    after: Steps = Field(default_factory=list)
    """Brings the rig back to where the next trial starts; plays also when a trial ended early."""


class ReferenceSource(Source):
    """Published values to print beside the estimates."""

    label: Annotated[str, StringConstraints(min_length=1, max_length=80)]
    """Where they come from."""
    by: Name
    """The parameter with choices that decides which values are compared."""
    values: Annotated[dict[Name, dict[ModelParameter, Expression]], Field(min_length=1)]
    """For each choice, the value of each parameter of the model."""


class IdentifySource(Source):
    """What `rigd identify` makes of the recording."""

    model: FileName
    """Name of the model."""
    signals: dict[Name, ChannelName]
    """The channel that gives each signal of the model."""
    constants: dict[Name, Expression] = Field(default_factory=dict)
    """Known quantities of the model."""
    group_by: Annotated[list[Name], OneOrMore()] = Field(default_factory=list)
    """Parameters whose values separate one identification from the next."""
    reference: ReferenceSource | None = None
    """Published values to print beside the estimates."""


#: "Every n-th row".
Every = Annotated[int, Ge(1), Le(1_000_000)]


class WindowSource(Source):
    """What is recorded of a stream, and during which steps."""

    every: Every = 1
    """Every n-th row (1: all)."""
    during: Annotated[list[StepName], Field(min_length=1), OneOrMore()]
    """The steps during which it is recorded."""


def _stream_kind(value: object) -> str:
    return "window" if isinstance(value, dict) else "every"


def _record_kind(value: object) -> Any:
    return "all" if isinstance(value, str) else "streams"


#: Every n-th row, or `{every: n, during: [step, ...]}`.
StreamRecord = Annotated[
    Annotated[Every, Tag("every")] | Annotated[WindowSource, Tag("window")],
    Discriminator(_stream_kind),
]
Record = Annotated[
    Annotated[Literal["all"], Tag("all")]
    | Annotated[dict[Name, StreamRecord], Field(min_length=1), Tag("streams")],
    Discriminator(_record_kind),
]


class ProcedureSource(Source):
    """A procedure: what is varied, what is done, what is recorded."""

    procedure: FileName
    """Name of the procedure."""
    title: Annotated[str, StringConstraints(min_length=1, max_length=200)]
    """One line for a person."""
    doc: Annotated[str, StringConstraints(min_length=1, max_length=10_000)]
    """What it is for and where it comes from."""
    parameters: dict[Name, ParameterSource] = Field(default_factory=dict)
    """Values that may differ from run to run, or from trial to trial."""
    tables: dict[Name, TableSource] = Field(default_factory=dict)
    """Values that follow from a parameter with choices."""
    sweep: SweepSource = SweepSource()
    """The trials; without it there is one."""
    repeats: Annotated[int, Ge(1), Le(1000)] = 1
    """How often each point of the sweep is played."""
    prepare: Steps = Field(default_factory=list)
    """Once, before the first trial."""
    trial: TrialSource
    """At each point of the sweep."""
    finish: Steps = Field(default_factory=list)
    """Once, after the last trial or a controlled stop; never after an abort or a fault."""
    record: Record = "all"
    """`all`, or for each stream "every n-th row" (1: all), with or without the steps during which
    it is recorded; streams not named are left out."""
    identify: IdentifySource | None = None
    """What the recording is for."""
    on_client_loss: Literal["continue", "finish_trial", "stop"] = "stop"
    """What the run does when the client that steers it remotely vanishes: go on, stop after the
    trial under way, or stop at once (controlled, `finish` plays)."""
