"""Plays a compiled procedure on the rig's plant, and says how long it takes and how near limits.

The same engine, the same interlocks and the same plant as the run itself; only the recording is
left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from rigd.config.rig import RigConfig
from rigd.engine.answers import OwnAnswers
from rigd.engine.clock import VirtualClock
from rigd.engine.control import Control
from rigd.engine.host import InProcessHost
from rigd.engine.mount import CYCLE_STREAM
from rigd.engine.run import Run, RunResult
from rigd.engine.wiring import wire
from rigd.model.limits import Action
from rigd.procedure.program import CompiledProcedure, CycleProgram, Segment
from rigd.rehearsal.peaks import PeakSink


@dataclass(frozen=True)
class StepRow:
    """One step of the table: what it does, and its duration over all trials, in s."""

    block: str
    name: str
    setpoints: str
    ends: str
    played: int
    shortest_s: float
    longest_s: float


@dataclass(frozen=True)
class Peak:
    """The predicted extremes of a limited channel beside its limits, in SI."""

    channel: str
    unit: str
    lowest: float
    highest: float
    low: float
    high: float
    limit_by: str  #: what sets the limit: the rig file, an interlock, the procedure's trial

    @property
    def inside(self) -> bool:
        """Whether the prediction stays within the limits."""
        return self.low <= self.lowest and self.highest <= self.high


@dataclass(frozen=True)
class Rehearsal:
    """What a dry run found. ``refusals`` says why the procedure must not run; empty if it may."""

    duration_s: float
    steps: tuple[StepRow, ...]
    peaks: tuple[Peak, ...]
    refusals: tuple[str, ...]
    result: RunResult


def rehearse(procedure: CompiledProcedure, rig: RigConfig, seed: int) -> Rehearsal:
    """Play ``procedure`` on the simulated plant of ``rig`` in virtual time.

    Raises:
        Blocked: the rig has no plant, or preflight refuses.
    """
    control = Control()
    clock = VirtualClock(rig.period_ns, 0)
    wiring = wire(rig, clock, control, seed)
    sink = PeakSink()
    everything = {s.name: 1 for s in wiring.cycle.rig.streams if s.name != CYCLE_STREAM.name}
    host = InProcessHost(wiring.cycle, clock, virtual=True, sink=sink, decimation=everything)
    change = None if wiring.plant is None else wiring.plant.change
    answering = replace(procedure, decimation=everything)
    result = Run(answering, host, sink, control, OwnAnswers(), change).execute()
    peaks = tuple(_peaks(procedure, rig, sink))
    refusals = list(sink.trips)
    refusals += [f"a setpoint of {name} is beyond its limit" for name in sorted(sink.cut)]
    if result.exit_code and not sink.trips and not result.incomplete:
        refusals.append(result.reason)
    refusals += [f"trial {n} would end early: {why}" for n, why in result.incomplete]
    steps = tuple(_step_rows(procedure, sink, clock.now()))
    return Rehearsal(clock.now() * 1e-9, steps, peaks, tuple(dict.fromkeys(refusals)), result)


def _peaks(procedure: CompiledProcedure, rig: RigConfig, sink: PeakSink) -> Iterator[Peak]:
    """Yield every limited channel: setpoints, interlocked channels, per-trial limits."""
    for device in rig.devices.values():
        for setpoint in device.setpoints:
            limit = device.limits[setpoint.name]
            low, high = sink.peaks.get(f"{device.name}.{setpoint.name}_setpoint", (0.0, 0.0))
            yield Peak(
                f"{device.name}.{setpoint.name} (setpoint)", setpoint.unit, low, high,
                limit.low, limit.high, "rig limit",
            )  # fmt: skip
    for interlock in rig.interlocks:
        channel = rig.channel(interlock.source)
        bounds = [
            bound if isinstance(bound, int | float) else default
            for bound, default in ((interlock.low, -math.inf), (interlock.high, math.inf))
        ]
        if channel is None or bounds == [-math.inf, math.inf] or interlock.action is Action.WARN:
            continue
        low, high = sink.peaks.get(interlock.source, (math.nan, math.nan))
        yield Peak(
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
                yield Peak(
                    bound.channel, "" if channel is None else channel.unit, low, high,
                    bound.low, bound.high, "trial limit",
                )  # fmt: skip


def _step_rows(procedure: CompiledProcedure, sink: PeakSink, end_ns: int) -> Iterator[StepRow]:
    """Yield one row per step of the procedure, in the order of first play."""
    blocks = dict(_segments(procedure))
    durations: dict[str, list[float]] = {}
    ends = [t_ns for t_ns, _, _ in sink.steps[1:]] + [end_ns]
    for (t_ns, _, name), until in zip(sink.steps, ends, strict=True):
        durations.setdefault(name, []).append((until - t_ns) * 1e-9)
    for name, played in durations.items():
        block, segment = blocks[name]
        yield StepRow(
            block, name, _describe_setpoints(segment), _describe_end(segment),
            len(played), min(played), max(played),
        )  # fmt: skip


def _segments(procedure: CompiledProcedure) -> Iterator[tuple[str, tuple[str, Segment]]]:
    """Yield every segment by name with its block, that of the first trial which plays it last."""
    blocks = [("prepare", procedure.prepare)]
    for trial in procedure.trials:
        blocks += [("trial", trial.steps), ("after", trial.after)]
    blocks.append(("finish", procedure.finish))
    for block, steps in reversed(blocks):
        for step in steps:
            if isinstance(step, CycleProgram):
                for segment in step.segments:
                    yield segment.name, (block, segment)


def _describe_setpoints(segment: Segment) -> str:
    words = []
    for name, profile in segment.setpoints.items():
        value = getattr(profile, "value", None)
        shown = type(profile).__name__.lower() if value is None else f"{value:.6g}"
        words.append(f"{name} = {shown}")
    return ", ".join(words)


def _describe_end(segment: Segment) -> str:
    ways = []
    for row in segment.until:
        conditions = []
        for one in row:
            source = f"|{one.channel}|" if one.magnitude else one.channel
            held = f" for {one.for_s:g} s" if one.for_s else ""
            conditions.append(f"{source} {one.comparison.value} {one.threshold:.6g}{held}")
        ways.append(" and ".join(conditions))
    if segment.duration_s is not None:
        ways.append(f"after {segment.duration_s:g} s")
    text = " or ".join(ways)
    if segment.timeout_s is not None:
        text += f" (at most {segment.timeout_s:g} s)"
    return text
