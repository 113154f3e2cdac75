"""Plays a compiled procedure on the simulated plant; returns duration and margins to limits.

The dry run uses the same engine, the same interlocks and the same plant as the run itself. Only the
recording is left out. A procedure with steps that can be held is played once more, and each of them
is held: what happens then refuses it too.

A real rig has no plant. Its procedure plays on the plant of the simulated sibling that its file
names; without a sibling nothing is played, and the result has only what the procedure states.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from rigd.computed.controllers.chain import sequence
from rigd.computed.controllers.driver import ControllerConfig
from rigd.config.checks.following import unseen_levels
from rigd.config.rig import RigConfig
from rigd.config.sibling.differences import Difference, pace
from rigd.config.sibling.sibling import read_sibling
from rigd.dry_run.at_limit import AtLimit
from rigd.dry_run.elsewhere import for_sibling
from rigd.dry_run.holding import HoldingHost, can_be_held, spans_of, with_holds
from rigd.dry_run.missing_measures import missing_measures
from rigd.dry_run.peaks import PeakSink
from rigd.dry_run.steps import StepRow, longest_of, step_rows, written_rows
from rigd.dry_run.swings import PASSAGES, Swings
from rigd.dry_run.wrong_sign import Departures, Turn, TurnedHost
from rigd.engine.clock import VirtualClock
from rigd.engine.cycle.mount import CYCLE_STREAM
from rigd.engine.cycle.wiring import wire
from rigd.engine.play.control import Control
from rigd.engine.process.in_process import InProcessHost
from rigd.engine.run.answers import OwnAnswers
from rigd.engine.run.draws import trial_seeds
from rigd.engine.run.result import RunResult
from rigd.engine.run.run import Run
from rigd.model.severity import Severity
from rigd.model.units import format_quantity
from rigd.procedure.program import CompiledProcedure, CycleProgram, Fault, Prompt, Recorded

#: What the figures of a dry run come from: the plant of the rig itself, that of its sibling, or the
#: procedure alone.
Physics = Literal["plant", "sibling", "none"]


@dataclass(frozen=True)
class PredictedPeak:
    """The predicted extremes of a limited channel beside its limits, in SI.

    ``display`` is the unit in which people read the channel.
    """

    channel: str
    unit: str
    lowest: float
    highest: float
    low: float
    high: float
    limit_by: str  #: the source of the limit: the rig file, an interlock, the procedure's trial
    display: str = ""

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
    result: RunResult | None = None  #: of what was played
    physics: Physics = "plant"
    #: The sibling that was played: its name and file; "" without.
    sibling: str = ""
    #: What differs between the files of rig and sibling.
    differences: tuple[Difference, ...] = ()
    #: What a reader must know of this dry run, in sentences.
    notes: tuple[str, ...] = ()
    #: Without physics ``duration_s`` is the longest, and this the time of what is known.
    known_s: float | None = None


def dry_run(procedure: CompiledProcedure, rig: RigConfig, seed: int) -> DryRunResult:
    """Play ``procedure`` in virtual time on the plant of ``rig``, or on that of its sibling.

    Without either nothing is played: devices are never opened. The result then has the steps with
    the durations that the procedure states.

    Raises:
        Blocked: preflight refuses, or the sibling lacks what the procedure uses.
        ConfigError: the sibling is wrong.
    """
    found = _dry_run(procedure, rig, seed)
    unseen = unseen_levels(procedure.on(rig), procedure.constant_levels())
    return replace(found, notes=(*found.notes, *unseen))


def _dry_run(procedure: CompiledProcedure, rig: RigConfig, seed: int) -> DryRunResult:
    """Return the result on the plant of ``rig``, of its sibling, or without any."""
    if rig.plant is not None:
        return _dry_run_with_plant(procedure, procedure.on(rig), seed)
    sibling = read_sibling(rig)
    if sibling is None:
        return _dry_run_without_plant(procedure, procedure.on(rig))
    real = procedure.on(rig)
    stand_in = sibling.stand_in(real)
    fitted, faults = for_sibling(procedure, stand_in, real)
    found = _dry_run_with_plant(replace(fitted, derived={}), stand_in, seed)
    return replace(
        found,
        refusals=(*found.refusals, *_out_of_sibling_range(stand_in, found.peaks)),
        physics="sibling",
        sibling=f"{sibling.rig.name} ({sibling.rig.source.path})",
        differences=sibling.differences,
        notes=(*found.notes, *_faults_note(faults), *_pace_notes(real, sibling.rig)),
    )


def _pace_notes(rig: RigConfig, sibling: RigConfig) -> Iterator[str]:
    """Yield the controllers whose readings come otherwise on the rig than they did here."""
    configs = [device.config for device in rig.devices.values()]
    for config in (item for item in configs if isinstance(item, ControllerConfig)):
        for name in sorted({item.partition(".")[0] for item in rig.readings_in(config.measured)}):
            here, there = pace(rig.devices[name]), pace(sibling.devices[name])
            if here != there:
                yield (
                    f"{config.name}: readings of {name} come {here} on the rig, and {there} in the "
                    "sibling: gains that are too high for that show on the rig alone"
                )


def _dry_run_without_plant(procedure: CompiledProcedure, rig: RigConfig) -> DryRunResult:
    """Return what the procedure alone states, without any physics."""
    known_s, most_s = longest_of(procedure)
    steps = list(procedure.steps())
    prompts = sum(isinstance(step, Prompt) for step in steps)
    notes = [
        f"rig {rig.name} has no `plant`, and its file names no `sibling`: nothing was played",
        "not known: peaks of measured channels, trips of interlocks, trials that end early, when "
        "end conditions hold",
    ]
    if prompts:
        notes.append(
            f"{_count(prompts, 'prompt waits', 'prompts wait')} for an answer: not counted"
        )
    notes += _faults_note(sum(isinstance(step, Fault) for step in steps))
    notes += missing_measures(procedure, {})
    return DryRunResult(
        most_s, written_rows(procedure, rig), (), (), physics="none", notes=tuple(notes),
        known_s=known_s,
    )  # fmt: skip


def _faults_note(count: int) -> tuple[str, ...]:
    if not count:
        return ()
    return (f"{_count(count, 'fault is', 'faults are')} not shown: only devices at the wire do",)


def _count(count: int, single: str, several: str) -> str:
    return f"{count} {single if count == 1 else several}"


def _out_of_sibling_range(rig: RigConfig, peaks: Sequence[PredictedPeak]) -> Iterator[str]:
    """Yield the setpoints that leave the range of their device in ``rig``, the simulated sibling.

    The real rig takes them, but the physics of the sibling does not hold there.
    """
    for device in rig.devices.values():
        for setpoint in device.setpoints:
            name = f"{device.name}.{setpoint.name}"
            for peak in peaks:
                if peak.channel == f"{name} (setpoint)" and not (
                    setpoint.low <= peak.lowest and peak.highest <= setpoint.high
                ):
                    low, high = (
                        format_quantity(item, setpoint.shown_in)
                        for item in (setpoint.low, setpoint.high)
                    )
                    yield (
                        f"{name} leaves {low} to {high}, which the device of the sibling takes: "
                        "its physics is not that of the rig there"
                    )


def _saturation(rig: RigConfig, peaks: Sequence[PredictedPeak]) -> Iterator[str]:
    """Yield measured channels that come to the end of their range: their peaks may be beyond."""
    for peak in peaks:
        channel = rig.channel(peak.channel)
        if channel is None:
            continue
        low, high = channel.ends
        for end, is_reached in (
            (channel.low, peak.lowest <= low),
            (channel.high, peak.highest >= high),
        ):
            if is_reached:
                shown = format_quantity(end, channel.shown_in)
                yield f"{peak.channel} reaches the end of its range, {shown}: its peak is not known"


def _dry_run_with_plant(procedure: CompiledProcedure, rig: RigConfig, seed: int) -> DryRunResult:
    """Return the result of playing the procedure on the plant of ``rig``."""
    sink, clock, result = _play(procedure, rig, seed)
    refusals = _refusals(sink, result, rig) or [*_wrong_signs(procedure, rig, seed, sink)]
    if not refusals and can_be_held(procedure):
        spans_ns = spans_of(sink.steps, clock.now())
        held, _, ending = _play(with_holds(procedure), rig, seed, spans_ns)
        refusals = [
            f"with each step held once: {reason}" for reason in _refusals(held, ending, rig)
        ]
    peaks = tuple(_peaks(procedure, rig, sink))
    refusals += _saturation(rig, peaks)
    steps = step_rows(procedure, rig, sink.steps, clock.now())
    notes = tuple(missing_measures(procedure, {} if refusals else sink.peaks))
    return DryRunResult(
        clock.now() * 1e-9, steps, peaks, tuple(dict.fromkeys(refusals)), result, notes=notes
    )


def _play(
    procedure: CompiledProcedure,
    rig: RigConfig,
    seed: int,
    spans_ns: Mapping[tuple[int, str], int] | None = None,
    turn: Turn | None = None,
) -> tuple[PeakSink, VirtualClock, RunResult]:
    """Play ``procedure``; with ``spans_ns``, how long its steps take, hold those that can be.

    With ``turn``, the gains of a controller are turned around in a part of it.
    """
    control = Control()
    clock = VirtualClock(rig.period_ns, 0)
    wiring = wire(rig, clock, control, seed)
    held = [name.partition(".") for name in rig.loops]
    swings = {name: Swings(f"{channel}_setpoint") for name, _, channel in held}
    configs = [device.config for device in rig.devices.values()]
    loops = [item for item in configs if isinstance(item, ControllerConfig)]
    sink = PeakSink(
        swings=swings,
        at_limit={item.name: AtLimit(item) for item in loops},
        departures={item.name: Departures(item) for item in loops},
    )
    record = {s.name: Recorded() for s in wiring.cycle.rig.streams if s.name != CYCLE_STREAM.name}
    host = InProcessHost(wiring.cycle, clock, virtual=True, sink=sink, record=record)
    if spans_ns is not None:
        host = HoldingHost(wiring.cycle, clock, sink=sink, record=record, spans_ns=spans_ns)
    if turn is not None and wiring.bank is not None:
        host = TurnedHost(
            wiring.cycle, clock, sink=sink, record=record, bank=wiring.bank, turn=turn
        )
    answering = replace(procedure, record=record)
    run = Run(answering, host, control, OwnAnswers())
    plant = wiring.plant
    if plant is not None:
        seeds = trial_seeds(seed, rig.name, procedure.name, procedure.trials)
        run = replace(run, change=plant.change, draw=plant.begin_trial, seeds=seeds)
    return sink, clock, run.execute()


def _wrong_signs(
    procedure: CompiledProcedure, rig: RigConfig, seed: int, sink: PeakSink
) -> Iterator[str]:
    """Yield why the gains of a controller have the wrong sign; of what it commands first.

    An outer controller goes the wrong way too if one that it commands does: the first is named.
    """
    for setpoint in reversed(sequence(rig.loops) or ()):
        found = sink.departures[setpoint.partition(".")[0]]
        departure = found.end()
        if departure is not None:
            turn = Turn(found.config, departure)
            _play(procedure, rig, seed, turn=turn)
            if turn.reason:
                yield turn.reason
                return


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
    refusals += [f"trial {n} would end early: {why}" for n, why in result.incomplete]
    return refusals or [reason for item in sink.at_limit.values() if (reason := item.end())]


def _peaks(procedure: CompiledProcedure, rig: RigConfig, sink: PeakSink) -> Iterator[PredictedPeak]:
    """Yield every limited channel: setpoints, interlocked channels, per-trial limits."""
    for device in rig.devices.values():
        for setpoint in device.setpoints:
            limit = device.limits[setpoint.name]
            low, high = sink.peaks.get(f"{device.name}.{setpoint.name}_setpoint", (0.0, 0.0))
            yield PredictedPeak(
                f"{device.name}.{setpoint.name} (setpoint)", setpoint.unit, low, high,
                limit.low, limit.high, "rig limit", setpoint.shown_in,
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
            f"interlock {interlock.name}", channel.shown_in,
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
                    "" if channel is None else channel.shown_in,
                )  # fmt: skip
