"""Builds the step table of a dry run: what each step does, how it ends, and how long it takes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rigd.config.rig import RigConfig
from rigd.model.units import format_quantity
from rigd.procedure.agreement import check_of
from rigd.procedure.condition_text import describe_condition
from rigd.procedure.profiles import ConstantProfile, Profile, Ramp
from rigd.procedure.program import (
    CompiledProcedure,
    Condition,
    CycleProgram,
    Prompt,
    Segment,
    StatusCondition,
)


@dataclass(frozen=True)
class StepRow:
    """A step of the table: its action, and its duration over all trials, in s.

    ``setpoints`` and ``ends`` have a line each; values that the sweep varies are given as a range.
    """

    block: str
    name: str
    setpoints: tuple[str, ...]
    ends: tuple[str, ...]
    played: int
    shortest_s: float
    longest_s: float


def step_rows(
    procedure: CompiledProcedure,
    rig: RigConfig,
    played: Sequence[tuple[int, int, str]],
    end_ns: int,
) -> tuple[StepRow, ...]:
    """Return one row per step, in the order of first play.

    ``played`` has (time in ns, trial number, step name) at the start of each step.
    """
    variants: dict[str, list[Segment]] = {}
    blocks: dict[str, str] = {}
    for block, segment in _segments(procedure):
        variants.setdefault(segment.name, []).append(segment)
        blocks[segment.name] = block
    durations: dict[str, list[float]] = {}
    ends = [t_ns for t_ns, _, _ in played[1:]] + [end_ns]
    for (t_ns, _, name), until in zip(played, ends, strict=True):
        durations.setdefault(name, []).append((until - t_ns) * 1e-9)
    return tuple(
        StepRow(
            blocks[name],
            name,
            tuple(_setpoints(variants[name], rig)),
            tuple(_ends(variants[name])),
            len(seconds),
            min(seconds),
            max(seconds),
        )
        for name, seconds in durations.items()
    )


def _segments(procedure: CompiledProcedure) -> Iterator[tuple[str, Segment]]:
    blocks = [("prepare", procedure.prepare)]
    for trial in procedure.trials:
        blocks += [("trial", trial.steps), ("after", trial.after)]
    blocks.append(("finish", procedure.finish))
    for block, steps in blocks:
        for step in steps:
            played = step if isinstance(step, CycleProgram) else None
            if isinstance(step, Prompt) and step.answer is not None:
                played = check_of(step, step.answer)
            for segment in () if played is None else played.segments:
                yield block, segment


def _setpoints(variants: Sequence[Segment], rig: RigConfig) -> Iterator[str]:
    for name in dict.fromkeys(name for variant in variants for name in variant.setpoints):
        channel = rig.setpoint(name)
        unit = "1" if channel is None else channel.unit
        profiles = [variant.setpoints[name] for variant in variants if name in variant.setpoints]
        constants = [profile.value for profile in profiles if isinstance(profile, ConstantProfile)]
        if len(constants) == len(profiles):
            yield f"{name} = {_range(constants, unit)}"
        else:
            yield f"{name}: {_profile(profiles[0], unit)}"


def _profile(profile: Profile, unit: str) -> str:
    kind = type(profile).__name__.lower()
    if isinstance(profile, Ramp):
        return f"{kind} to {format_quantity(profile.end, unit)} in {profile.duration_s:g} s"
    amplitude = getattr(profile, "amplitude", None)
    return kind if amplitude is None else f"{kind} of {format_quantity(amplitude, unit)}"


def _ends(variants: Sequence[Segment]) -> Iterator[str]:
    first = variants[0]
    for position, row in enumerate(first.until):
        yield " and ".join(
            _condition(condition, [variant.until[position][place] for variant in variants])
            for place, condition in enumerate(row)
        )
    if first.duration_s is not None:
        yield f"after {_range([variant.duration_s or 0.0 for variant in variants], 's')}"
    if first.timeout_s is not None:
        yield f"at most {_range([variant.timeout_s or 0.0 for variant in variants], 's')}"


def _condition(
    condition: Condition | StatusCondition, variants: Sequence[Condition | StatusCondition]
) -> str:
    if isinstance(condition, StatusCondition):
        return describe_condition(condition)
    thresholds = [variant.threshold for variant in variants if isinstance(variant, Condition)]
    return describe_condition(condition, _range(thresholds, condition.unit))


def _range(values: Sequence[float], unit: str) -> str:
    low, high = min(values), max(values)
    if low == high:
        return format_quantity(low, unit)
    return f"{low:.6g} .. {format_quantity(high, unit)}"
