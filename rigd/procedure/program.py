"""The compiled form of a procedure: plain data that the cycle plays.

Everything that must happen on time (profiles, end conditions, per-trial limits) is a
:class:`CycleProgram`; everything that waits for a person is a :class:`Prompt`; what a simulated
device shall get wrong is a :class:`Fault`. All values are in SI. Channels are written
``device.channel``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum

from rigd.model.channels import STATUS_FIELD
from rigd.procedure.profiles import Profile


class Comparison(Enum):
    """How a condition compares a channel with its threshold."""

    ABOVE = ">"
    BELOW = "<"


@dataclass(frozen=True)
class Condition:
    """``channel > threshold`` (or of its magnitude), true without a break for ``for_s`` seconds.

    ``unit`` is the channel's, for people.
    """

    channel: str
    comparison: Comparison
    threshold: float
    magnitude: bool = False
    for_s: float = 0.0
    unit: str = field(default="1", compare=False)


@dataclass(frozen=True)
class StatusCondition:
    """``device is word`` (or ``is not``), true without a break for ``for_s`` seconds.

    ``mask`` holds the bits of the device's status word that ``word`` stands for.
    """

    device: str
    word: str
    mask: int
    wanted: bool = True
    for_s: float = 0.0

    @property
    def channel(self) -> str:
        """The status word, where the other conditions have their channel."""
        return f"{self.device}.{STATUS_FIELD}"


#: What ends a segment: any of the rows, in which all must hold.
Until = tuple[tuple[Condition | StatusCondition, ...], ...]


class OnTimeout(Enum):
    """What a segment that ran out of time means."""

    FAIL = "fail"  #: the procedure did not do what it must: the run ends as failed
    END_TRIAL = "end_trial"  #: this trial ends, marked incomplete; the sweep goes on
    NEXT = "next"  #: as good as an end condition


@dataclass(frozen=True)
class Segment:
    """One step on the cycle.

    Setpoints not named keep their last value. The segment ends when every condition of one row of
    ``until`` holds (any of all), when ``duration_s`` has passed, or at ``timeout_s``.
    """

    name: str
    setpoints: Mapping[str, Profile] = field(default_factory=dict)
    until: Until = ()
    duration_s: float | None = None
    timeout_s: float | None = None
    on_timeout: OnTimeout = OnTimeout.FAIL


@dataclass(frozen=True)
class TrialLimit:
    """A bound that holds while a trial plays; beyond it the trial ends, marked incomplete."""

    channel: str
    low: float
    high: float


@dataclass(frozen=True)
class CycleProgram:
    """Segments played one after the other by the cycle, under per-trial limits."""

    segments: tuple[Segment, ...]
    limits: tuple[TrialLimit, ...] = ()


#: What a person answers: a quantity in SI, a word, any text, or yes.
Answer = float | str | bool


class OnClientLoss(Enum):
    """What becomes of a run that was started remotely once whoever steers it has vanished."""

    CONTINUE = "continue"  #: it goes on; a prompt waits for somebody else
    FINISH_TRIAL = "finish_trial"  #: it stops once the trial under way has ended
    STOP = "stop"  #: it stops at once, controlled: to rest, then `finish`


class AnswerKind(Enum):
    """What a prompt accepts."""

    CONFIRM = "confirm"
    NUMBER = "number"
    CHOICE = "choice"
    TEXT = "text"


@dataclass(frozen=True)
class Agreement:
    """``channel`` must show a prompt's answer: within ``within``, for ``for_s`` seconds.

    ``within`` is a share of the answer where ``is_share``, else in SI. ``stable`` is what the
    device itself says of its reading, where it does.
    """

    channel: str
    within: float
    is_share: bool
    for_s: float = 0.0
    stable: StatusCondition | None = None


@dataclass(frozen=True)
class Prompt:
    """A question to the operator, with a typed answer.

    ``answer`` is the procedure's own answer, used in simulation and with ``--yes``. A simulated
    rig obeys by changing ``changes`` on its plant to the answer. ``low``/``high`` (SI) or
    ``choices`` bound what is accepted. What must then be seen within ``timeout_s`` before anything
    moves is ``until``, and the answer itself where it ``agrees``.
    """

    name: str
    text: str
    kind: AnswerKind = AnswerKind.CONFIRM
    unit: str = "1"
    choices: tuple[str, ...] = ()
    low: float | None = None
    high: float | None = None
    answer: Answer | None = None
    changes: str | None = None
    until: Until = ()
    agrees: Agreement | None = None
    timeout_s: float | None = None


@dataclass(frozen=True)
class Fault:
    """A fault that a device simulated at the wire shows, in words that the simulation knows.

    It begins ``after_s`` after the step is reached, and lasts ``for_s``; None: until the run ends.
    """

    part: str
    fault: str
    after_s: float = 0.0
    for_s: float | None = None
    options: Mapping[str, int | float | bool | str] = field(default_factory=dict)


Step = CycleProgram | Prompt | Fault


@dataclass(frozen=True)
class TrialPlan:
    """One point of the sweep: its parameters (SI values or text), which repeat, and its steps.

    ``number`` counts trials from 1 in the order of the sweep as written, not as played; each
    repeat has a number of its own, so a number names one trial of a run.
    ``after`` brings the rig back to where the next trial starts; it also plays when the trial
    ended early (timeout, per-trial limit, an interlock that ends trials), not after a stop.
    """

    number: int
    repeat: int
    parameters: Mapping[str, float | str | bool]
    steps: tuple[Step, ...]
    after: tuple[Step, ...] = ()


@dataclass(frozen=True)
class IdentifyPlan:
    """What ``rigd identify`` makes of the recording: a model, its signals and known constants.

    A constant is an SI value or, where the sweep varies it, the name of the trial parameter that
    gives it. ``group_by`` names the parameters whose values separate one identification from the
    next. ``reference`` holds published values of the model's parameters (SI), ``reference_label``
    where they come from; they are printed beside the estimates and never used.
    """

    model: str
    signals: Mapping[str, str]
    constants: Mapping[str, float | str]
    group_by: tuple[str, ...] = ()
    reference: Mapping[str, float] = field(default_factory=dict)
    reference_label: str = ""


@dataclass(frozen=True)
class Recorded:
    """What is recorded of a stream: every ``every``-th row.

    Where ``during`` names steps, only of the rows taken while one of these plays.
    """

    every: int = 1
    during: frozenset[str] = frozenset()


@dataclass(frozen=True)
class CompiledProcedure:
    """A procedure checked against a rig and ready to play.

    ``parameters`` are the procedure's own after ``--set``; ``trials`` stand in the order of play.
    ``record`` says what is recorded of each stream; one that it does not name is not recorded.
    ``units`` gives the unit of every numeric parameter, for people.
    """

    name: str
    title: str
    parameters: Mapping[str, float | str | bool]
    units: Mapping[str, str]
    prepare: tuple[Step, ...]
    trials: tuple[TrialPlan, ...]
    finish: tuple[Step, ...]
    record: Mapping[str, Recorded]
    identify: IdentifyPlan | None = None
    on_client_loss: OnClientLoss = OnClientLoss.STOP

    def steps(self) -> Iterator[Step]:
        """Yield every step of every block, in no particular order."""
        yield from self.prepare
        yield from self.finish
        for trial in self.trials:
            yield from (*trial.steps, *trial.after)
