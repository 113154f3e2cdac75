"""Defines the compiled form of a procedure: plain data that the cycle plays.

- :class:`CycleProgram`: the parts with exact timing (profiles, end conditions, per-trial limits);
- :class:`Prompt`: a question that waits for a person;
- :class:`Fault`: a fault that a simulated device must show.

All values are in SI units. Channels are written ``device.channel``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

from rigd.config.rig import DeviceConfig, RigConfig
from rigd.model.channels import STATUS_FIELD
from rigd.model.constants import Uncertainty
from rigd.procedure.profiles.profiles import ConstantProfile, Profile


class Comparison(Enum):
    """How a condition compares a channel with its threshold."""

    ABOVE = ">"
    BELOW = "<"


@dataclass(frozen=True)
class Condition:
    """``channel > threshold`` (or of its magnitude), without interruption for ``for_s``, in s.

    ``unit`` is the channel's, for messages.
    """

    channel: str
    comparison: Comparison
    threshold: float
    magnitude: bool = False
    for_s: float = 0.0
    unit: str = field(default="1", compare=False)


@dataclass(frozen=True)
class StatusCondition:
    """``device is word`` (or ``is not``), true without interruption for ``for_s`` seconds.

    ``mask`` has the bits of the device's status word that ``word`` means.
    """

    device: str
    word: str
    mask: int
    wanted: bool = True
    for_s: float = 0.0

    @property
    def channel(self) -> str:
        """The status word, in place of a channel."""
        return f"{self.device}.{STATUS_FIELD}"


#: The end of a segment: any of the rows, of which all conditions must hold.
Until = tuple[tuple[Condition | StatusCondition, ...], ...]


class OnTimeout(Enum):
    """The effect of a segment that ran out of time."""

    FAIL = "fail"  #: the procedure failed its task: the run ends as failed
    END_TRIAL = "end_trial"  #: this trial ends, marked incomplete; the sweep continues
    NEXT = "next"  #: counts as an end condition


@dataclass(frozen=True)
class Hold:
    """What applies while a segment is held: constant ``setpoints`` (SI), for ``longest_s`` at most.

    A setpoint that is not named keeps the value that it has reached.
    """

    setpoints: Mapping[str, float]
    longest_s: float


@dataclass(frozen=True)
class Segment:
    """One step on the cycle.

    Setpoints not named keep their last value. The segment ends when every condition of one row of
    ``until`` holds (any of all), after ``duration_s``, or at ``timeout_s``. With ``hold`` a pause
    holds it in its midst; without, a pause waits for the end of the trial.
    """

    name: str
    setpoints: Mapping[str, Profile] = field(default_factory=dict)
    until: Until = ()
    duration_s: float | None = None
    timeout_s: float | None = None
    on_timeout: OnTimeout = OnTimeout.FAIL
    hold: Hold | None = None


@dataclass(frozen=True)
class TrialLimit:
    """A bound during a trial; beyond it the trial ends, marked incomplete.

    ``unit`` is the channel's, for messages.
    """

    channel: str
    low: float
    high: float
    unit: str = field(default="1", compare=False)


@dataclass(frozen=True)
class CycleProgram:
    """Segments played one after the other by the cycle, under per-trial limits."""

    segments: tuple[Segment, ...]
    limits: tuple[TrialLimit, ...] = ()


#: The answer of a person: a quantity in SI, a word, any text, or yes.
Answer = float | str | bool


class OnClientLoss(Enum):
    """The action of a run that was started remotely when its client is lost."""

    CONTINUE = "continue"  #: the run continues; a prompt waits for another client
    FINISH_TRIAL = "finish_trial"  #: the run stops after the present trial
    STOP = "stop"  #: the run stops at once, controlled: to rest, then `finish`


class AnswerKind(Enum):
    """The kind of answer that a prompt accepts."""

    CONFIRM = "confirm"
    NUMBER = "number"
    CHOICE = "choice"
    TEXT = "text"


@dataclass(frozen=True)
class Agreement:
    """``channel`` must agree with a prompt's answer: within ``within``, for ``for_s`` seconds.

    ``within`` is a share of the answer if ``is_share``, else in SI. ``stable`` is the device's own
    report that its reading is at rest, if it has one.
    """

    channel: str
    within: float
    is_share: bool
    for_s: float = 0.0
    stable: StatusCondition | None = None


@dataclass(frozen=True)
class Prompt:
    """A question to the operator, with a typed answer.

    ``answer`` is the procedure's own answer, used in simulation and with ``--yes``. A simulated rig
    follows the answer: it sets ``changes`` on its plant to it. ``low``/``high`` (SI) or ``choices``
    bound the accepted answers. Before anything moves, ``until`` must hold within ``timeout_s``, and
    the channel of ``agrees`` must show the answer.
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
    """A fault that a device simulated at the wire shows, with the names of the simulation.

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
    """A point of the sweep: its parameters (SI values or text), its repeat, and its steps.

    ``number`` counts trials from 1 in the order of the sweep as written, not as played; each repeat
    has its own number, so a number identifies a trial of a run. ``after`` returns the rig to the
    start of the next trial; it also plays if the trial ended early (timeout, per-trial limit, an
    interlock that ends trials), but not after a stop.
    """

    number: int
    repeat: int
    parameters: Mapping[str, float | str | bool]
    steps: tuple[Step, ...]
    after: tuple[Step, ...] = ()


#: Conditions of which any row must hold.
Events = tuple[tuple[Condition, ...], ...]


@dataclass(frozen=True)
class Window:
    """The part of a trial: a step (None: all of them) from ``begin_s`` to ``end_s`` in it.

    ``last_s`` counts back from the end of the step instead. In that part, what is measured begins
    when ``since`` begins to hold for the ``nth`` time, ends when ``until`` does next, and is all
    for which ``holds`` does; empty ones do not count.
    """

    step: str | None = None
    begin_s: float = 0.0
    end_s: float = math.inf
    last_s: float | None = None
    since: Events = ()
    until: Events = ()
    holds: Events = ()
    nth: int = 1


@dataclass(frozen=True, eq=False)
class Measure:
    """A quantity read off one trial; all numbers in SI.

    ``kind`` is a key of the file (``mean``); ``channel`` is "" for a duration, ``since`` empty if
    it begins with the window. ``unit`` is that in which people read it. ``systematic`` is the
    standard uncertainty of what measures it, the same in all trials (None: not stated). ``low`` and
    ``high`` are what the result must be between, if it ``is_judged``.
    """

    name: str
    kind: str
    channel: str
    window: Window
    unit: str
    when: Events = ()
    since: Events = ()
    systematic: Uncertainty | None = None
    low: float = -math.inf
    high: float = math.inf
    is_judged: bool = False
    doc: str = ""


class TrialCheck(Enum):
    """What a run does about a trial that the analysis cannot use."""

    WARN = "warn"  #: state it, and go on
    ASK = "ask"  #: ask the operator whether to go on
    END = "end"  #: end the run


@dataclass(frozen=True)
class IdentifyPlan:
    """The plan of ``rigd identify`` for a recording: a model, its signals and known constants.

    A constant is an SI value or, if the sweep varies it, the name of the trial parameter with its
    value. ``uncertainties`` and ``units`` are those of constants, if known. ``group_by`` names the
    parameters whose values separate identifications. ``reference`` has published values of the
    model's parameters (SI), ``reference_label`` their source; they are printed beside the estimates
    and never used. ``check`` is what a run does about a trial that the analysis cannot use.
    """

    model: str
    signals: Mapping[str, str]
    constants: Mapping[str, float | str]
    group_by: tuple[str, ...] = ()
    reference: Mapping[str, float] = field(default_factory=dict)
    reference_label: str = ""
    uncertainties: Mapping[str, Uncertainty] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    check: TrialCheck | None = None


@dataclass(frozen=True)
class Capture:
    """A stream is recorded around the times at which ``when`` holds."""

    when: Until
    before_s: float
    after_s: float


@dataclass(frozen=True)
class Recorded:
    """The recorded part of a stream: every ``every``-th row.

    With ``during``, only rows taken while one of these steps plays; with ``capture``, only those
    around what it waits for.
    """

    every: int = 1
    during: frozenset[str] = frozenset()
    capture: Capture | None = None

    @property
    def windowed(self) -> bool:
        """Whether only some times are recorded."""
        return bool(self.during) or self.capture is not None


@dataclass(frozen=True)
class CompiledProcedure:
    """A procedure checked against a rig and ready to play.

    ``parameters`` are the procedure's own after ``--set``; ``trials`` are in the order of play.
    ``record`` has the recorded part of each stream; a stream without entry is not recorded.
    ``measures`` are those of the first trial. ``units`` gives the unit of every numeric parameter,
    for people. ``derived`` are the groups of derived channels, those of the rig included, if the
    procedure adds some (see :meth:`on`).
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
    measures: tuple[Measure, ...] = ()
    on_client_loss: OnClientLoss = OnClientLoss.STOP
    derived: Mapping[str, DeviceConfig] = field(default_factory=dict)

    def on(self, rig: RigConfig) -> RigConfig:
        """Return ``rig`` with the derived channels of this procedure, compiled for ``rig``."""
        if not self.derived:
            return rig
        return replace(rig, devices={**rig.devices, **self.derived})

    def constant_levels(self) -> Iterator[tuple[str, str, float]]:
        """Yield step, setpoint and value (SI) of every setpoint that a step holds constant."""
        for step in self.steps():
            for segment in step.segments if isinstance(step, CycleProgram) else ():
                for name, profile in segment.setpoints.items():
                    if isinstance(profile, ConstantProfile):
                        yield segment.name, name, profile.value

    def steps(self) -> Iterator[Step]:
        """Yield every step of every block, in no particular order."""
        yield from self.prepare
        yield from self.finish
        for trial in self.trials:
            yield from (*trial.steps, *trial.after)
