"""Runs an FMU between channels of a rig: its inputs are channels, its outputs become channels.

The FMU steps in a process of its own, beside the cycle. Cycle k gives it the values that the cycle
has read and the setpoints that it has written; until the next cycle the FMU has time for the step,
and cycle k + 1 reads the state of the model at the time of cycle k + 1. So the outputs of a cycle
follow from the inputs of the cycle before; with a ``step`` of n cycles, of n cycles before.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final

from annotated_types import Ge, Gt, Le
from pydantic import BeforeValidator, Field, PrivateAttr, ValidationInfo, model_validator

from rigd.model.units import si_symbol
from rigd.sdk import (
    Channel,
    Declaration,
    DeviceError,
    Documented,
    Driver,
    DriverConfig,
    In,
    Input,
    WrongEntries,
)
from rigd_sim.fmu.description import FmuFile, Variable
from rigd_sim.fmu.device import Name, Output, conversion_of, numeric_variable, wrong_key
from rigd_sim.fmu.messages import Wires
from rigd_sim.fmu.options import UnitOptions, misfit
from rigd_sim.fmu.process import FmuProcess
from rigd_sim.fmu.units import FmuUnit, as_stated

#: SCHED_FIFO priority of the steps: below the cycle's 80, above all ordinary programs.
PRIORITY: Final = 60
#: Steps by which the time of one is judged before the rig is armed; the shortest counts.
TRIED: Final = 20
#: An input was late when the FMU got it: its device gave no row, or a channel of it is too old.
INPUT_LATE: Final = 1
#: Channels that each FMU in the loop has beside the outputs of its FMU.
OWN: Final = (
    Channel("spent", "s", "time that the FMU took for the steps of this row; 0 in virtual time"),
    Channel("late", "1", "number of cycles by which this row came late"),
)


class LoopInput(Documented):
    """An input of the FMU, and the channel that it gets."""

    channel: str
    """Channel of the rig, `device.channel`; a setpoint as `device.setpoint_setpoint`."""
    unit: str | None = None
    """Unit of the FMU's numbers; needed if the FMU gives none."""

    _conversion: FmuUnit = PrivateAttr(default=as_stated("1"))

    @property
    def conversion(self) -> FmuUnit:
        """How a value in SI becomes a number of the FMU."""
        return self._conversion

    def resolve(self, name: str, fmu: FmuFile) -> None:
        """Find the input ``name`` of the FMU.

        Raises:
            ValueError: there is none, or its unit is not known.
        """
        variable = numeric_variable(fmu, name, is_input=True)
        self._conversion = variable.unit or self._stated(variable)
        if variable.unit is not None and self.unit is not None:
            variable.unit.check(self.unit)

    def _stated(self, variable: Variable) -> FmuUnit:
        if self.unit is not None:
            return as_stated(self.unit)
        if variable.kind not in ("Real", "Float64", "Float32"):
            return as_stated("1")
        raise ValueError(
            f"the FMU gives {variable.name!r} no unit that rigd can read: write "
            f"{{channel: {self.channel}, unit: ...}} with the unit of its numbers"
        )


def _short(value: Any) -> Any:
    """Return ``{channel: NAME}`` for a bare NAME."""
    return {"channel": value} if isinstance(value, str) else value


class FmuInLoopConfig(UnitOptions, DriverConfig):
    """Which FMU, what it gets and gives, and how much time it has."""

    inputs: dict[str, Annotated[LoopInput, BeforeValidator(_short)]] = Field(default_factory=dict)
    """Channels that inputs of the FMU get, by variable: `{force: traction.force}`."""
    outputs: dict[Name, Output] = Field(default_factory=dict)
    """Channels, by name: `{speed: v}` or `{speed: {variable: v, unit: m/s}}`."""
    step: Annotated[float, In("s"), Gt(0), Le(10)] | None = None
    """Communication step: the cycle, a whole fraction of it, or a whole number of cycles."""
    budget: Annotated[float, In("s"), Gt(0)] | None = None
    """Longest time for the steps between two rows; by default all that there is."""
    late: Annotated[int, Ge(0), Le(10000)] = 3
    """Cycles in succession that may be late or above the budget before it is a fault."""

    _period_ns: int = PrivateAttr(default=1_000_000)

    @model_validator(mode="after")
    def _it_fits_the_rig(self, info: ValidationInfo) -> FmuInLoopConfig:
        """Compare variables with the FMU, and times with the cycle, if the context has it."""
        self._period_ns = (info.context or {}).get("period_ns") or self._period_ns
        fmu = self.fmu
        problems: list[tuple[tuple[str | int, ...], str]] = []
        if not self.outputs:
            problems.append(((), "name at least one of the FMU's variables under 'outputs'"))
        for name, item in self.inputs.items():
            try:
                item.resolve(name, fmu)
            except ValueError as error:
                problems.append((("inputs", name), str(error)))
        for name, part in self.outputs.items():
            try:
                part.resolve(name, fmu)
            except ValueError as error:
                problems.append((("outputs", name, wrong_key(error)), str(error)))
            if name in {channel.name for channel in OWN}:
                problems.append((("outputs", name), f"{name!r} is taken: choose another name"))
        key, text = self._mistimed(fmu)
        if text:
            problems.append(((key,), text))
        if problems:
            raise WrongEntries(problems)
        return self

    def _mistimed(self, fmu: FmuFile) -> tuple[str, str]:
        """Return the option whose time cannot hold, and why; "" if all can."""
        period_ns, step_ns = self._period_ns, self.step_ns
        cycle = f"a cycle of {period_ns * 1e-6:g} ms"
        if max(period_ns, step_ns) % min(period_ns, step_ns):
            return "step", (
                f"a step of {step_ns * 1e-6:g} ms is neither {cycle} nor a whole fraction or "
                "multiple of it"
            )
        if text := misfit(fmu, step_ns):
            return ("file" if self.step is None else "step"), f"{text}: give 'step'"
        if self.budget is not None and self.budget * 1e9 > self.latency_ns:
            return "budget", (
                f"a budget of {self.budget * 1e3:g} ms cannot hold: rows are due every "
                f"{self.latency_ns * 1e-6:g} ms"
            )
        return "", ""

    @property
    def period_ns(self) -> int:
        """Time of a cycle."""
        return self._period_ns

    @property
    def step_ns(self) -> int:
        """The communication step."""
        return self._period_ns if self.step is None else round(self.step * 1e9)

    @property
    def latency_ns(self) -> int:
        """Time from the inputs to the outputs that follow from them: a step, at least a cycle."""
        return max(self._period_ns, self.step_ns)

    @property
    def budget_ns(self) -> int:
        """Longest time for the steps between two rows."""
        return self.latency_ns if self.budget is None else round(self.budget * 1e9)

    def files(self) -> Mapping[Path, str]:
        """Return what the FMU is, and its model description, as files beside it."""
        folder = Path(self.file).parent
        more = {"step_s": self.step_ns * 1e-9, "latency_s": self.latency_ns * 1e-9}
        return {folder / name: text for name, text in self.explained(**more).items()}


class FmuInLoop(Driver[FmuInLoopConfig, None]):
    """An FMU as a device that takes channels of the rig. It moves nothing: it is always safe.

    A row stands at the time of the model. Late rows are made up for: the next request takes as many
    steps as the model lags behind.
    """

    Config: ClassVar[type[DriverConfig]] = FmuInLoopConfig
    title: ClassVar[str] = "FMU between channels of the rig"

    def __init__(self, config: FmuInLoopConfig, link: None = None) -> None:
        super().__init__(config, link)
        fmu = config.fmu
        self._from_si = [item.conversion.from_si for item in config.inputs.values()]
        self._to_si: list[Callable[[float], float]] = [
            conversion_of(fmu.variables[part.variable], part.channel.unit).to_si
            for part in config.outputs.values()
        ]
        self._wires = Wires(*(
            [(fmu.variables[name].kind, fmu.variables[name].reference) for name in names]
            for names in (config.inputs, (part.variable for part in config.outputs.values()))
        ))  # fmt: skip
        self._process: FmuProcess | None = None
        self._model_ns = -1  #: time of the model; -1 before the first cycle that knew all inputs
        self._steps = 0  #: taken, and begun
        self._begun = 0  #: of the last request
        self._due_ns = -1  #: when the row that was begun is due; -1 if there is none
        self._held = 0  #: status of that row
        self._first: list[float] | None = None  #: outputs at the start, until they are read
        self._late = 0  #: cycles in succession that were late or above the budget
        self._unknown = "has not come yet"  #: why the model has not begun

    @classmethod
    def declare(cls, config: FmuInLoopConfig) -> Declaration:
        """Return outputs of the FMU as channels, and the channels that it gets."""
        latency_s = config.latency_ns * 1e-9
        return Declaration(
            channels=(*(part.channel for part in config.outputs.values()), *OWN),
            plain_rows=True,
            has_status=True,
            status_bits={"input_late": INPUT_LATE},
            inputs=tuple(
                Input(item.channel, si_symbol(item.conversion.dimension), ("inputs", name))
                for name, item in config.inputs.items()
            ),
            every_cycle=False,
            # The driver names what is late itself, long before the cycle does.
            silent_s=max(1.0, 10 * (config.late + 2) * latency_s),
            oldest_s=latency_s if config.latency_ns > config.period_ns else 0.0,
        )

    def open(self) -> None:
        """Set the FMU up in a process of its own.

        Raises:
            DeviceError: it cannot be set up.
        """
        self._process = process = self._started()
        fmu = self.config.fmu
        self.identity = f"{fmu.model}, FMI {fmu.version}, {fmu.tool}"
        self._first = process.take(0, 0, [])

    def preflight(self) -> Sequence[str]:
        """Return that the steps take longer than the budget, if they do on this machine."""
        if self.lockstep:
            return ()
        tried, config = self._started(), self.config
        per_row = config.latency_ns // config.step_ns
        inputs, shortest_s = [0.0] * len(config.inputs), math.inf
        try:
            for turn in range(TRIED):
                tried.begin(turn * per_row, per_row, inputs)
                shortest_s = min(shortest_s, tried.wait(per_row)[0])
        except DeviceError:
            return ()  # with inputs that no run gives it: the run itself shows whether it fails
        finally:
            tried.close()
        if shortest_s * 1e9 <= config.budget_ns:
            return ()
        return (
            f"the steps of {config.fmu.path.name} for a row take {shortest_s * 1e3:.3g} ms on this "
            f"machine at best, and the budget is {config.budget_ns * 1e-6:g} ms: give a longer "
            "'step', or a faster model",
        )

    def arm(self) -> None:
        """Check that the model has begun.

        Raises:
            DeviceError: an input is not known.
        """
        if self._model_ns < 0:
            raise DeviceError(f"the model has not begun: {self._unknown}")

    def read(self, t_ns: int) -> Sequence[float] | None:
        """Return the state of the model if its row is due and there.

        Raises:
            DeviceError: the FMU failed, or is late or above its budget for too long.
        """
        if self._due_ns < 0:
            return self._at_start(t_ns)
        if t_ns < self._due_ns or self._process is None:
            return None
        answer = self._process.wait(self._begun) if self.lockstep else self._process.poll()
        late = (t_ns - self._due_ns) // self.config.period_ns
        if answer is None:
            self._count_late(f"late by {late + 1} cycles")
            return None
        took_s, numbers = answer
        if not all(map(math.isfinite, numbers)):
            raise self._no_number(numbers)
        if self.lockstep:
            took_s = 0.0
        elif took_s * 1e9 > self._allowed_ns():
            self._count_late(f"above the budget: {took_s * 1e3:.3g} ms")
        elif not late:
            self._late = 0
        self.taken_ns = self._model_ns = self._due_ns
        self._due_ns = -1
        return [*self._in_si(numbers), took_s, float(late), float(self._held)]

    def take_inputs(self, t_ns: int, values: Sequence[float], *, late: bool) -> None:
        """Begin the steps up to the next row.

        Raises:
            DeviceError: an input was no number for too long.
        """
        if self._due_ns >= 0 or t_ns < self._model_ns or self._process is None:
            return
        if not all(map(math.isfinite, values)):
            self._note_unknown(values)
            return
        if self._model_ns < 0:
            self._model_ns = t_ns
        config = self.config
        count = (t_ns + config.latency_ns - self._model_ns) // config.step_ns
        inputs = [to(value) for to, value in zip(self._from_si, values, strict=True)]
        self._process.begin(self._steps, count, inputs)
        self._begun = count
        self._steps += count
        self._due_ns = self._model_ns + count * config.step_ns
        self._held = INPUT_LATE * late

    def make_safe(self) -> None:
        """Do nothing: it only computes."""

    def close(self) -> None:
        """End the process of the FMU."""
        if self._process is not None:
            self._process.close()

    def _started(self) -> FmuProcess:
        config = self.config
        process = FmuProcess(
            config.fmu,
            config.start_values(),
            step_ns=config.step_ns,
            setup_s=config.set_up,
            deadline_s=config.deadline,
            priority=0 if self.lockstep else PRIORITY,
        )
        process.wire(self._wires)
        return process

    def _at_start(self, t_ns: int) -> Sequence[float] | None:
        """Return the outputs before the first step: at the start, then NaN until it is begun."""
        if self._model_ns >= 0:
            return None  # an input is not known: no step was begun
        numbers, self._first = self._first, None
        values = [math.nan] * len(self._to_si) if numbers is None else self._in_si(numbers)
        return [*values, 0.0, 0.0, 0.0]

    def _in_si(self, numbers: Sequence[float]) -> list[float]:
        return [to(number) for to, number in zip(self._to_si, numbers, strict=True)]

    def _allowed_ns(self) -> float:
        """Return the budget for the steps of the last request, more if rows were late."""
        config = self.config
        return config.budget_ns * max(1.0, self._begun * config.step_ns / config.latency_ns)

    def _count_late(self, what: str) -> None:
        self._late += 1
        if self._late > self.config.late and self._process is not None:
            at_s = (self._steps - self._begun) * self.config.step_ns * 1e-9
            raise self._process.refuse(
                f"the step at {at_s:.9g} s is {what}; late or above its budget of "
                f"{self.config.budget_ns * 1e-6:g} ms in {self._late} cycles in succession, and "
                f"'late' allows {self.config.late}"
            )

    def _note_unknown(self, values: Sequence[float]) -> None:
        channels = [item.channel for item in self.config.inputs.values()]
        pairs = zip(channels, values, strict=True)
        channel, value = next(pair for pair in pairs if not math.isfinite(pair[1]))
        self._unknown = f"its input {channel} is {value}"
        if self._model_ns < 0:
            return  # at rest: a slow device has no row yet
        self._late += 1
        if self._late > self.config.late:
            raise DeviceError(f"{self._unknown} in {self._late} cycles in succession")

    def _no_number(self, numbers: Sequence[float]) -> DeviceError:
        names = [part.variable for part in self.config.outputs.values()]
        pairs = zip(names, numbers, strict=True)
        name, value = next(pair for pair in pairs if not math.isfinite(pair[1]))
        at_s = self._steps * self.config.step_ns * 1e-9
        error = DeviceError(f"{name!r} is {value} after {at_s:.9g} s")
        return error if self._process is None else self._process.refuse(str(error))
