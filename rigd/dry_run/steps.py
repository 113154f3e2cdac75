"""Builds the step table of a dry run: what each step does, how it ends, and how long it takes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from rigd.config.quantities import rate_unit
from rigd.config.rig import RigConfig
from rigd.model.units import format_difference, format_quantity, parse_unit
from rigd.procedure.conditions.condition_text import describe_condition
from rigd.procedure.profiles.profiles import ConstantProfile, Profile, Ramp
from rigd.procedure.program import (
    CompiledProcedure,
    Condition,
    CycleProgram,
    Prompt,
    Segment,
    StatusCondition,
)
from rigd.procedure.steps.agreement import check_of

#: How the duration of a step is known: it was `played` on physics; or without physics, it is
#: `known` from the procedure, or only that it ends `at_most` at its timeout.
Timing = Literal["played", "known", "at_most"]


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
    timing: Timing = "played"


def step_rows(
    procedure: CompiledProcedure,
    rig: RigConfig,
    played: Sequence[tuple[int, int, str]],
    end_ns: int,
) -> tuple[StepRow, ...]:
    """Return one row per step, in the order of first play.

    ``played`` has (time in ns, trial number, step name) at the start of each step.
    """
    variants, blocks = _by_name(procedure)
    durations: dict[str, list[float]] = {}
    ends = [t_ns for t_ns, _, _ in played[1:]] + [end_ns]
    for (t_ns, _, name), until in zip(played, ends, strict=False):  # perhaps no step began
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


def written_rows(procedure: CompiledProcedure, rig: RigConfig) -> tuple[StepRow, ...]:
    """Return one row per step, in the order of the procedure, without any physics.

    The duration of a step without end conditions is known; any other lasts from 0 s to its timeout.
    Each setpoint has the fastest change that the rig file permits.
    """
    variants, blocks = _by_name(procedure)
    rows = []
    for name, segments in variants.items():
        waits = any(segment.until for segment in segments)
        longest = [_longest_s(segment) for segment in segments]
        rows.append(
            StepRow(
                blocks[name],
                name,
                tuple(f"{text}{rate}" for text, rate in _rated(segments, rig)),
                tuple(_ends(segments)),
                len(segments),
                0.0 if waits else min(longest),
                max(longest),
                "at_most" if waits else "known",
            )
        )
    return tuple(rows)


def longest_of(procedure: CompiledProcedure) -> tuple[float, float]:
    """Return the time of all steps in s: of those with a known duration, and of all at most."""
    known = most = 0.0
    for _, segment in _segments(procedure):
        longest_s = _longest_s(segment)
        most += longest_s
        known += 0.0 if segment.until else longest_s
    return known, most


def _longest_s(segment: Segment) -> float:
    times = (segment.duration_s, segment.timeout_s)
    return min(time_s for time_s in times if time_s is not None)


def _by_name(procedure: CompiledProcedure) -> tuple[dict[str, list[Segment]], dict[str, str]]:
    """Return the variants of each step, one for each time it plays, and its block."""
    variants: dict[str, list[Segment]] = {}
    blocks: dict[str, str] = {}
    for block, segment in _segments(procedure):
        variants.setdefault(segment.name, []).append(segment)
        blocks[segment.name] = block
    return variants, blocks


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


def _rated(variants: Sequence[Segment], rig: RigConfig) -> Iterator[tuple[str, str]]:
    """Yield each setpoint as text, with the rate that its limit permits."""
    names = dict.fromkeys(name for variant in variants for name in variant.setpoints)
    for name, text in zip(names, _setpoints(variants, rig), strict=True):
        device, _, short = name.partition(".")
        channel, rate = rig.setpoint(name), rig.devices[device].limits[short].rate
        if channel is None or math.isinf(rate):
            yield text, ""
        else:
            yield text, f", at most {format_quantity(rate, rate_unit(channel.unit))}"


def _setpoints(variants: Sequence[Segment], rig: RigConfig) -> Iterator[str]:
    for name in dict.fromkeys(name for variant in variants for name in variant.setpoints):
        channel = rig.setpoint(name)
        unit = "1" if channel is None else channel.shown_in
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
    return kind if amplitude is None else f"{kind} of {format_difference(amplitude, unit)}"


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
    shown = parse_unit(unit).from_si(low)
    return f"{shown:.6g} .. {format_quantity(high, unit)}"
