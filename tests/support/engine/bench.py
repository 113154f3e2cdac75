"""A bench small enough to reason about: one axis that integrates its speed, one temperature."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import ClassVar

from rigd.engine.clock import VirtualClock
from rigd.engine.cycle.cycle import Cycle
from rigd.engine.cycle.limiter import Limiter
from rigd.engine.cycle.mount import mount
from rigd.engine.play.control import Control
from rigd.engine.play.interlocks import InterlockBank
from rigd.engine.process.in_process import InProcessHost
from rigd.engine.run.answers import OwnAnswers
from rigd.engine.run.run import Run
from rigd.engine.sink import Rows
from rigd.model.limits import Interlock, SetpointLimit
from rigd.procedure.profiles.profiles import ConstantProfile
from rigd.procedure.program import (
    CompiledProcedure,
    CycleProgram,
    Recorded,
    Segment,
    Step,
    TrialPlan,
)
from rigd.sdk import Channel, Declaration, Driver, DriverConfig, Link, Row

PERIOD_NS = 1_000_000


class AxisRow(Row):
    position: float
    load: float


class Axis(Driver[DriverConfig, None]):
    """An axis whose position is the integral of its speed setpoint; safe means standing still."""

    setpoints: ClassVar[tuple[Channel, ...]] = (Channel("speed", "m/s", low=-2, high=2),)

    def __init__(self) -> None:
        super().__init__(DriverConfig(), None)
        self.position = 0.0
        self.load = 1.0
        self.speed = 0.0
        self.written: list[float] = []
        self.safe_calls = 0
        self.armed = False
        self.closed = False
        self.log: list[str] = []
        self.answer: Callable[[int], Sequence[float] | None] | None = None

    @classmethod
    def declare(cls, config: DriverConfig) -> Declaration:
        return Declaration(
            channels=(Channel("position", "m"), Channel("load", "N")),
            row=AxisRow,
            setpoints=cls.setpoints,
        )

    def open(self) -> None:
        pass

    def arm(self) -> None:
        self.armed = True

    def read(self, t_ns: int) -> Sequence[float] | None:
        self.position += self.speed * PERIOD_NS * 1e-9
        if self.answer is not None:
            return self.answer(t_ns)
        return AxisRow.of(position=self.position, load=self.load)

    def write(self, setpoints: Sequence[float]) -> None:
        (self.speed,) = setpoints
        self.written.append(self.speed)

    def make_safe(self) -> None:
        self.speed = 0.0
        self.safe_calls += 1

    def close(self) -> None:
        self.closed = True


class Stubborn(Axis):
    """A device that fails to be made safe."""

    setpoints = ()

    def make_safe(self) -> None:
        self.safe_calls += 1
        raise RuntimeError("relay welded")


@dataclass
class ListSink:
    """Keeps what a run produces in memory."""

    events: list[tuple[int, str, int, Mapping[str, object]]] = field(default_factory=list)
    rows: dict[str, int] = field(default_factory=dict)
    closed: bool = False
    log: list[str] = field(default_factory=list)  #: kinds of events, in one list with others

    def write(self, stream: str, rows: Rows) -> None:
        self.rows[stream] = self.rows.get(stream, 0) + len(rows)

    def event(self, t_ns: int, kind: str, trial: int, data: Mapping[str, object]) -> None:
        self.events.append((t_ns, kind, trial, data))
        self.log.append(kind)

    def flush(self, *, complete: bool = False) -> None:
        pass

    def close(self) -> None:
        self.closed = True

    def kinds(self) -> list[str]:
        return [kind for _, kind, _, _ in self.events]

    def steps(self) -> list[object]:
        return [data["name"] for _, kind, _, data in self.events if kind == "step"]


@dataclass
class Bench:
    """The small bench, wired as a rig is."""

    axis: Axis = field(default_factory=Axis)
    other: Stubborn = field(default_factory=Stubborn)
    interlocks: tuple[Interlock, ...] = ()
    limit: SetpointLimit = field(default_factory=lambda: SetpointLimit(-1.5, 1.5, 100.0))
    sink: ListSink = field(default_factory=ListSink)
    control: Control = field(default_factory=Control)

    def cycle(self, links: Mapping[str, Link] = MappingProxyType({})) -> Cycle:
        devices = {"other": ("stubborn", self.other), "axis": ("axis", self.axis)}
        rig = mount(devices, links)
        units = {
            f"{item.name}.{channel.name}": channel.unit
            for item in rig.mounts
            for channel in item.driver.declaration.channels
        }
        return Cycle(
            rig,
            Limiter([self.limit], PERIOD_NS * 1e-9),
            InterlockBank(self.interlocks, rig.readings, units, rig.stamp_of, rig.setpoints),
            VirtualClock(PERIOD_NS, 1_000_000_000_000),
            self.control,
        )

    def host(self) -> InProcessHost:
        cycle = self.cycle()
        return InProcessHost(
            cycle,
            cycle.clock,
            virtual=True,
            sink=self.sink,
            record={stream.name: Recorded() for stream in cycle.rig.streams},
        )

    def run(self, procedure: CompiledProcedure, **options: object) -> Run:
        return Run(
            procedure,
            self.host(),
            self.control,
            OwnAnswers(),
            **options,  # type: ignore[arg-type]  # tests name real fields of Run
        )


def move(name: str, speed: float, duration_s: float = 0.1) -> CycleProgram:
    return CycleProgram(
        (Segment(name, {"axis.speed": ConstantProfile(speed)}, duration_s=duration_s),)
    )


def procedure(
    *trials: Sequence[Step],
    prepare: Sequence[Step] = (),
    after: Sequence[Step] = (),
) -> CompiledProcedure:
    """A procedure whose `finish` is one step called home."""
    return CompiledProcedure(
        name="test",
        title="",
        parameters={},
        units={},
        prepare=tuple(prepare),
        trials=tuple(
            TrialPlan(number, 1, {}, tuple(steps), tuple(after))
            for number, steps in enumerate(trials, start=1)
        ),
        finish=(move("home", -0.5),),
        record={"axis": Recorded()},
    )
