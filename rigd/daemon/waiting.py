"""Says what a run that is paused does with its setpoints, and what follows."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import islice

from rigd.config.rig import RigConfig
from rigd.daemon.execute import RunRequest
from rigd.daemon.provenance import format_parameter, trial_label
from rigd.engine.run.result import Progress
from rigd.model.states import RunState
from rigd.procedure.program import CompiledProcedure, CycleProgram, Hold


def what_waits(progress: Progress, request: RunRequest) -> str:
    """Return what the setpoints do in a pause and what resume plays next; "" without a pause."""
    rig, procedure = request.rig, request.procedure
    if progress.state is RunState.PAUSED:
        follows = _next_trial(progress, request)
        return f"setpoints at rest: {', '.join(_at_rest(rig))}; then {follows}"
    hold = _hold(procedure, progress.step) if progress.state is RunState.HELD else None
    if hold is None:
        return ""
    goes = [f"{name} {_value(rig, name, value)}" for name, value in hold.setpoints.items()]
    rest = "the others keep their value" if goes else "setpoints keep their value"
    longest = "" if math.isnan(hold.longest_s) else f", for {hold.longest_s:.6g} s at most"
    return f"{', '.join([*goes, rest])}{longest}; then step {progress.step} goes on"


def _at_rest(rig: RigConfig) -> Iterator[str]:
    for device in rig.devices.values():
        for setpoint in device.setpoints if device.is_actuator else ():
            name, limit = f"{device.name}.{setpoint.name}", device.limits[setpoint.name]
            yield f"{name} " + ("kept" if limit.holds else _value(rig, name, limit.rest))


def _value(rig: RigConfig, name: str, value: float) -> str:
    channel = rig.setpoint(name)
    return f"{value:.6g}" if channel is None else format_parameter(value, channel.shown_in)


def _hold(procedure: CompiledProcedure, name: str) -> Hold | None:
    """Return what the step of that name does while it is held, if it can be."""
    for step in procedure.steps():
        for segment in step.segments if isinstance(step, CycleProgram) else ():
            if segment.name == name and segment.hold is not None:
                return segment.hold
    return None


def _next_trial(progress: Progress, request: RunRequest) -> str:
    procedure = request.procedure
    done = request.resume.done if request.resume is not None else frozenset()
    left = (trial for trial in procedure.trials if trial.number not in done)
    trial = next(islice(left, progress.trials_done - len(done), None), None)
    if trial is None:
        return "the finish"
    which = f"trial {progress.trials_done + 1} of {progress.trials_total}"
    label = trial_label(trial, procedure)
    return f"{which}, {label}" if label else which
