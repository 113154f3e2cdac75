"""Plays a compiled procedure on the simulated plant; returns duration and margins to limits.

The dry run uses the same engine, the same interlocks and the same plant as the run itself. Only the
recording is left out. A procedure with steps that can be held is played once more, and each of them
is held: what happens then refuses it too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from rigd.config.rig import RigConfig
from rigd.dry_run.holding import HoldingHost, can_be_held, spans_of, with_holds
from rigd.dry_run.peaks import PeakSink
from rigd.dry_run.steps import StepRow, step_rows
from rigd.dry_run.swings import PASSAGES, Swings
from rigd.engine.answers import OwnAnswers
from rigd.engine.clock import VirtualClock
from rigd.engine.control import Control
from rigd.engine.in_process import InProcessHost
from rigd.engine.mount import CYCLE_STREAM
from rigd.engine.result import RunResult
from rigd.engine.run import Run
from rigd.engine.wiring import wire
from rigd.model.errors import Blocked
from rigd.model.severity import Severity
from rigd.procedure.program import CompiledProcedure, CycleProgram, Recorded


@dataclass(frozen=True)
class PredictedPeak:
    """The predicted extremes of a limited channel beside its limits, in SI."""

    channel: str
    unit: str
    lowest: float
    highest: float
    low: float
    high: float
    limit_by: str  #: the source of the limit: the rig file, an interlock, the procedure's trial

    @property
    def inside(self) -> bool:
        """Whether the prediction stays within the limits."""
        return self.low <= self.lowest and self.highest <= self.high


@dataclass(frozen=True)
class DryRunResult:
    """The result of a dry run. ``refusals``: why the procedure must not run; empty if it may."""

    duration_s: float
    steps: tuple[StepRow, ...]
    peaks: tuple[PredictedPeak, ...]
    refusals: tuple[str, ...]
    result: RunResult


def dry_run(procedure: CompiledProcedure, rig: RigConfig, seed: int) -> DryRunResult:
    """Play ``procedure`` on the simulated plant of ``rig`` in virtual time.

    Raises:
        Blocked: the rig has no plant, or preflight refuses.
    """
    if rig.plant is None:
        # Its devices would be opened, and moved as fast as they respond.
        raise Blocked(
            [
                f"rig {rig.name} has no `plant`: a dry run plays on a plant simulated in "
                "process, never on devices\n  give --rig the simulated version of this rig, "
                "such as lugre-1"
            ],
            "nothing is played",
        )
    rig = procedure.on(rig)
    sink, clock, result = _play(procedure, rig, seed)
    refusals = _refusals(sink, result, rig)
    if not refusals and can_be_held(procedure):
        spans_ns = spans_of(sink.steps, clock.now())
        held, _, ending = _play(with_holds(procedure), rig, seed, spans_ns)
        refusals = [
            f"with each step held once: {reason}" for reason in _refusals(held, ending, rig)
        ]
    peaks = tuple(_peaks(procedure, rig, sink))
    steps = step_rows(procedure, rig, sink.steps, clock.now())
    return DryRunResult(clock.now() * 1e-9, steps, peaks, tuple(dict.fromkeys(refusals)), result)


def _play(
    procedure: CompiledProcedure,
    rig: RigConfig,
    seed: int,
    spans_ns: Mapping[tuple[int, str], int] | None = None,
) -> tuple[PeakSink, VirtualClock, RunResult]:
    """Play ``procedure``; with ``spans_ns``, how long its steps take, hold those that can be."""
    control = Control()
    clock = VirtualClock(rig.period_ns, 0)
    wiring = wire(rig, clock, control, seed)
    held = [name.partition(".") for name in rig.loops]
    swings = {name: Swings(f"{channel}_setpoint") for name, _, channel in held}
    sink = PeakSink(swings=swings)
    record = {s.name: Recorded() for s in wiring.cycle.rig.streams if s.name != CYCLE_STREAM.name}
    host = InProcessHost(wiring.cycle, clock, virtual=True, sink=sink, record=record)
    if spans_ns is not None:
        host = HoldingHost(wiring.cycle, clock, sink=sink, record=record, spans_ns=spans_ns)
    change = None if wiring.plant is None else wiring.plant.change
    answering = replace(procedure, record=record)
    return sink, clock, Run(answering, host, control, OwnAnswers(), change).execute()


def _refusals(sink: PeakSink, result: RunResult, rig: RigConfig) -> list[str]:
    """Return why the procedure must not run, from what it did."""
    refusals = list(sink.trips)
    refusals += [f"a setpoint of {name} exceeds its limit" for name in sorted(sink.cut)]
    loops = {name.partition(".")[0]: goal for name, goal in rig.loops.items()}
    refusals += [
        f"controller {name}: {loops[name]} swings from one limit to the other, "
        f"{found.most} times while the setpoint is constant: lower the gains"
        for name, found in sink.swings.items()
        if found.most >= PASSAGES
    ]
    if result.exit_code and not sink.trips and not result.incomplete:
        refusals.append(result.reason)
    return refusals + [f"trial {n} would end early: {why}" for n, why in result.incomplete]


def _peaks(procedure: CompiledProcedure, rig: RigConfig, sink: PeakSink) -> Iterator[PredictedPeak]:
    """Yield every limited channel: setpoints, interlocked channels, per-trial limits."""
    for device in rig.devices.values():
        for setpoint in device.setpoints:
            limit = device.limits[setpoint.name]
            low, high = sink.peaks.get(f"{device.name}.{setpoint.name}_setpoint", (0.0, 0.0))
            yield PredictedPeak(
                f"{device.name}.{setpoint.name} (setpoint)", setpoint.unit, low, high,
                limit.low, limit.high, "rig limit",
            )  # fmt: skip
    for interlock in rig.interlocks:
        channel = rig.channel(interlock.source)
        bounds = [
            bound if isinstance(bound, int | float) else default
            for bound, default in ((interlock.low, -math.inf), (interlock.high, math.inf))
        ]
        if channel is None or bounds == [-math.inf, math.inf] or interlock.action is Severity.WARN:
            continue
        low, high = sink.peaks.get(interlock.source, (math.nan, math.nan))
        yield PredictedPeak(
            interlock.source, channel.unit, low, high, bounds[0], bounds[1],
            f"interlock {interlock.name}",
        )  # fmt: skip
    seen = set()
    for trial in procedure.trials:
        for step in trial.steps:
            for bound in step.limits if isinstance(step, CycleProgram) else ():
                if bound in seen:
                    continue
                seen.add(bound)
                channel = rig.channel(bound.channel)
                low, high = sink.peaks.get(bound.channel, (math.nan, math.nan))
                yield PredictedPeak(
                    bound.channel, "" if channel is None else channel.unit, low, high,
                    bound.low, bound.high, "trial limit",
                )  # fmt: skip
