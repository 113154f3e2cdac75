"""Fits a procedure compiled for a real rig to the plant of its simulated sibling.

The program stays what it is: setpoints, end conditions, limits, times. Words of status are given as
the bits that the sibling's device has for them. Faults are left out: only devices at the wire can
show them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from rigd.config.rig import DeviceConfig, RigConfig
from rigd.config.sibling.differences import alike
from rigd.model.errors import Blocked
from rigd.procedure.program import (
    CompiledProcedure,
    Condition,
    CycleProgram,
    Fault,
    Prompt,
    Segment,
    StatusCondition,
    Step,
    Until,
)
from rigd.procedure.steps.prompts import change_problem, changeable_plants


def for_sibling(
    procedure: CompiledProcedure, rig: RigConfig, real: RigConfig
) -> tuple[CompiledProcedure, int]:
    """Return ``procedure`` for ``rig``, the stand-in of ``real``, which it was compiled for.

    Also the number of its faults, which are left out.

    Raises:
        Blocked: the sibling lacks channels or words of status that the procedure uses, or its plant
            cannot follow an answer.
    """
    fitting = _Fitting(rig, real)
    trials = tuple(
        replace(trial, steps=fitting.steps(trial.steps), after=fitting.steps(trial.after))
        for trial in procedure.trials
    )
    fitted = replace(
        procedure,
        prepare=fitting.steps(procedure.prepare),
        trials=trials,
        finish=fitting.steps(procedure.finish),
    )
    fitting.derived(procedure.derived)
    reasons = list(fitting.refused)
    if fitting.lacks:
        names = ", ".join(fitting.lacks)
        reasons.append(
            f"procedure {procedure.name} uses {names}, and the sibling has not\n"
            "  add what is missing to the sibling, or remove `sibling` from the rig file: "
            "without it a dry run computes no physics"
        )
    if reasons:
        raise Blocked(reasons, "nothing is played")
    return fitted, fitting.faults


@dataclass
class _Fitting:
    """Fits steps to ``rig``, the simulated stand-in of ``real``, and notes what ``rig`` lacks."""

    rig: RigConfig
    real: RigConfig
    faults: int = 0
    lacks: dict[str, None] = field(default_factory=dict)  #: in order, each once
    refused: dict[str, None] = field(default_factory=dict)  #: why a plant cannot follow answers
    #: Fitted segments by id() of the original one, which the procedure keeps alive.
    _segments: dict[int, Segment] = field(default_factory=dict)

    def steps(self, steps: tuple[Step, ...]) -> tuple[Step, ...]:
        return tuple(self._steps(steps))

    def derived(self, groups: Mapping[str, DeviceConfig]) -> None:
        """Note the channels of the derived ``groups`` that ``rig`` lacks."""
        for group in groups.values():
            graph = getattr(group.config, "graph", None)
            for used in () if graph is None else graph.uses.values():
                for name in sorted(used):
                    self._need(name)

    def _steps(self, steps: tuple[Step, ...]) -> Iterator[Step]:
        """Yield the steps for ``rig``; count and leave out faults."""
        for step in steps:
            if isinstance(step, Fault):
                self.faults += 1
            elif isinstance(step, Prompt):
                yield self._prompt(step)
            else:
                yield self._program(step)

    def _program(self, program: CycleProgram) -> CycleProgram:
        for limit in program.limits:
            self._need(limit.channel)
        return replace(program, segments=tuple(map(self._segment, program.segments)))

    def _segment(self, segment: Segment) -> Segment:
        """Return the segment with end conditions for ``rig``; trials may share one."""
        fitted = self._segments.get(id(segment))
        if fitted is None:
            fitted = replace(segment, until=self._until(segment.until))
            self._segments[id(segment)] = fitted
        return fitted

    def _prompt(self, prompt: Prompt) -> Prompt:
        """Return the prompt for ``rig``; note an answer that its plant cannot follow."""
        agrees = prompt.agrees
        if agrees is not None:
            self._need(agrees.channel)
            stable = None if agrees.stable is None else self._status(agrees.stable)
            agrees = replace(agrees, stable=stable)
        for plant in changeable_plants(self.rig):
            if (problem := change_problem(prompt, plant)) is not None:
                self.refused[f"prompt {prompt.name!r}: {problem.message}"] = None
        return replace(prompt, until=self._until(prompt.until), agrees=agrees)

    def _until(self, until: Until) -> Until:
        return tuple(tuple(self._condition(item) for item in row) for row in until)

    def _condition(self, condition: Condition | StatusCondition) -> Condition | StatusCondition:
        if isinstance(condition, StatusCondition):
            return self._status(condition)
        self._need(condition.channel)
        return condition

    def _status(self, condition: StatusCondition) -> StatusCondition:
        """Return the condition with the status bits that the device in ``rig`` has for its word."""
        device = self.rig.devices.get(condition.device)
        bits = {} if device is None else device.declaration.status_bits
        if condition.word not in bits:
            self.lacks[f"'{condition.device} is {condition.word}'"] = None
            return condition
        return replace(condition, mask=bits[condition.word])

    def _need(self, name: str) -> None:
        """Note the channel ``name`` if ``rig`` lacks it, or has it in another unit."""
        found, known = self.rig.recorded(name), self.real.recorded(name)
        if found is None:
            self.lacks[name] = None
        elif known is not None and not alike(found, known):
            self.lacks[f"{name} in {known.unit}"] = None
