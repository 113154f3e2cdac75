"""Converts a recorded trial of the approach-angle rig to the raw run that its analyses take.

The module resamples nothing: each stream keeps its own rate. Time comes from the clock of the
card, aligned to rigd's clock once per trial, and is zero at the relay COMMAND.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeGuard

import numpy as np
from numpy.typing import NDArray

from rigd.analysis import DataError, format_quantity
from rigd.analysis.recordings.source import (
    STALE,
    STATUS_FIELD,
    TIME_FIELD,
    RecordedSweep,
    Stream,
    TrialInfo,
)
from rigd_analyses.approach_angle.raw.flags import AT_END_SAMPLES
from rigd_analyses.approach_angle.raw.run_data import AngleRun, Flag, FloatArray, Severity
from rigd_analyses.approach_angle.raw.travel_beyond_stop import read_run_on

#: Samples of the card from so long before the relay command to so long after the stop are taken,
#: if so much was recorded. The analyses need 0.1 s before and 50 ms after.
BEFORE_NS: Final = 500_000_000
AFTER_NS: Final = 200_000_000
#: Channel of a card's own clock, as driver ``ni-daq`` names it: sample number over rate, in s.
DEVICE_TIME: Final = "device_time"
#: Bit of a scale's status word: its reading has come to rest (driver ``serial-scale``).
STABLE: Final = 1
#: A reading at rest counts if none that was not at rest came for longer after it.
REST_NS: Final = 2_000_000_000
#: The card's clock and rigd's may drift apart by so much over a run; blocks come late by less.
CLOCKS_S: Final = 0.02
#: Signals that one card samples; the last is optional.
SAMPLED: Final = ("gauge_a", "gauge_b", "wheel_angle", "platform_position", "normal_force")

Rows = NDArray[np.void]


@dataclass(frozen=True)
class Signals:
    """Places in one recording of the signals of a plan."""

    card: Stream
    fields: Mapping[str, str]  #: of the card, by signal
    relay: str
    command: str
    scale: str
    mass: str


@dataclass(frozen=True)
class _Drive:
    """The times of the commands to close and to open the relay; None if there was no command."""

    start_ns: int | None
    stop_ns: int | None
    count: int = 1  #: how often it was commanded to close in the trial


def read_run(sweep: RecordedSweep, trial: TrialInfo, signals: Signals) -> AngleRun:
    """Return ``trial`` as a run. What its recording lacks becomes a flag, not an error.

    Angle and load are those that were answered, if a prompt asked, not those that were planned.

    Raises:
        RecordingError: a chunk of the recording is damaged.
        DataError: the trial has no such parameter, or the plan lacks a constant.
    """
    drive = _drive(sweep, trial, signals)
    load_kg, planned_rad = _number(sweep, trial, "load"), sweep.constant(trial, "angle")
    put_on_kg, mounted_rad = trial.answers.get("load"), trial.answers.get("angle")
    planned = {"load": (load_kg, "kg"), "angle": (planned_rad, "deg")}
    flags = [*_unfinished(trial, drive), *_answered(trial, planned)]
    card = _card_rows(sweep, trial, signals, drive)
    zero_ns = trial.start_ns if drive.start_ns is None else drive.start_ns
    t_s = _times_s(card, zero_ns)
    stop_s = math.nan if drive.stop_ns is None else (drive.stop_ns - zero_ns) * 1e-9
    flags += _rails(signals, card[~(t_s > stop_s)])
    flags += _clocks(card, t_s, zero_ns)
    mass_kg, stable = _scale_kg(sweep, trial, signals, drive)
    volts = {name: np.ascontiguousarray(card[field]) for name, field in signals.fields.items()}
    return AngleRun(
        label=_label(sweep, trial),
        set_name=_set_name(sweep, trial),
        alpha_rad=mounted_rad if _is_number(mounted_rad) else planned_rad,
        announced_load_kg=put_on_kg if _is_number(put_on_kg) else load_kg,
        voltage_v=_number(sweep, trial, "voltage"),
        repeat=trial.repeat or 1,
        t_s=t_s,
        gauge_a_v=volts["gauge_a"],
        gauge_b_v=volts["gauge_b"],
        wheel_v=volts["wheel_angle"],
        platform_v=volts["platform_position"],
        stop_s=stop_s,
        load_n=mass_kg * sweep.constant(trial, "gravity"),
        load_stable=stable,
        normal_force_v=volts.get("normal_force"),
        wheel=_wheel(sweep, trial),
        number=trial.number,
        recording=str(sweep.path),
        planned_load_kg=load_kg,
        flags=tuple(flags),
        run_on=read_run_on(sweep, trial, card, signals.fields, signals.card, drive.stop_ns),
    )


def find_signals(sweep: RecordedSweep) -> Signals:
    """Return the places of the plan's signals in the recording.

    Raises:
        DataError: one was not recorded, or those of the card stand in several streams.
    """
    names = [name for name in SAMPLED if name in sweep.plan.signals]
    sampled = {name: sweep.field(name) for name in names}
    streams = dict.fromkeys(stream.name for stream, _ in sampled.values())
    if len(streams) > 1:
        raise DataError(
            f"{sweep.path}: {', '.join(names)} stand in several streams ({', '.join(streams)})",
            hint="gauges and potentiometers must be sampled by one card, on one clock",
        )
    relay, reading = sweep.field("relay")
    command = f"{reading}_setpoint"
    if command not in {channel.name for channel in relay.channels}:
        raise DataError(
            f"{sweep.path}: stream {relay.name!r} has no channel {command!r}",
            hint="the signal `relay` must be the reading of a setpoint, such as relay.closed",
        )
    scale, mass = sweep.field("load")
    return Signals(
        card=sampled[names[0]][0],
        fields={name: field for name, (_, field) in sampled.items()},
        relay=relay.name,
        command=command,
        scale=scale.name,
        mass=mass,
    )


def _is_number(value: object) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _answered(trial: TrialInfo, planned: Mapping[str, tuple[float, str]]) -> list[Flag]:
    """Return a note if load or angle, as answered, are not those that were planned."""
    differing = []
    for name, (value, unit) in planned.items():
        answer = trial.answers.get(name)
        if _is_number(answer) and not math.isclose(answer, value, rel_tol=1e-6):
            given, expected = (format_quantity(v, unit) for v in (answer, value))
            differing.append(f"{name} {given} (planned {expected})")
    if not differing:
        return []
    reason = f"The operator announced another {' and '.join(differing)}."
    return [Flag("other_than_planned", reason, Severity.NOTE)]


def _drive(sweep: RecordedSweep, trial: TrialInfo, signals: Signals) -> _Drive:
    """Return when the relay was commanded to close in ``trial``, and when to open after that."""
    rows = sweep.recording.read(signals.relay, trial.start_ns, trial.end_ns)
    closed = rows[signals.command] > 0.5
    if not closed.any():
        return _Drive(None, None)
    first = int(np.argmax(closed))
    opened = np.flatnonzero(~closed[first:])
    times = rows[TIME_FIELD]
    stop = None if not len(opened) else int(times[first + int(opened[0])])
    count = 1 + int(np.count_nonzero(closed[first + 1 :] & ~closed[first:-1]))
    return _Drive(int(times[first]), stop, count)


def _unfinished(trial: TrialInfo, drive: _Drive) -> list[Flag]:
    """Return what is wrong with the trial as a whole."""
    flags = []
    if not trial.complete:
        reason = (trial.reason or "the recording ends within it").rstrip(".")
        flags.append(Flag("incomplete", f"The trial was not completed: {reason}."))
    if drive.start_ns is None:
        flags.append(Flag("not_driven", "The relay was never commanded to close."))
    elif drive.stop_ns is None:
        flags.append(Flag("no_stop", "The relay was not commanded to open again within the trial."))
    elif drive.count > 1:
        flags.append(
            Flag(
                "driven_twice",
                f"The relay was commanded to close {drive.count} times in the trial: the platform "
                "did not begin each push at rest, at its start.",
            )
        )
    return flags


def _card_rows(sweep: RecordedSweep, trial: TrialInfo, signals: Signals, drive: _Drive) -> Rows:
    """Return the card's rows around the drive; none if there was no drive."""
    if drive.start_ns is None:
        rows = sweep.recording.read(signals.card.name, trial.start_ns, trial.start_ns)
    else:
        end = trial.end_ns if drive.stop_ns is None else drive.stop_ns + AFTER_NS
        # The rows of a block reach the file after the trial's end was noted; their times do not.
        begin = max(trial.start_ns, drive.start_ns - BEFORE_NS)
        rows = sweep.recording.read(signals.card.name, begin, end)
    if not signals.card.has_status:
        return rows
    fresh: Rows = rows[rows[STATUS_FIELD] & STALE == 0]
    return fresh


def _times_s(card: Rows, zero_ns: int) -> FloatArray:
    """Return the times of the card's rows since ``zero_ns``, evenly spaced if it has a clock.

    rigd's time of a row is an estimate that moves a little from block to block. Over the second of
    a run the card's own clock is the better one; the median difference lays it over rigd's.
    """
    t_s = (card[TIME_FIELD] - zero_ns) * 1e-9
    names = card.dtype.names or ()
    if DEVICE_TIME not in names or not len(card):
        return np.asarray(t_s)
    device_s = card[DEVICE_TIME] - card[DEVICE_TIME][0]
    return np.asarray(device_s + np.median(t_s - device_s))


def _clocks(card: Rows, t_s: FloatArray, zero_ns: int) -> list[Flag]:
    """Return a flag if the card's own clock, which ``t_s`` follows, is not rigd's."""
    apart = np.abs(t_s - (card[TIME_FIELD] - zero_ns) * 1e-9)
    bad = int(np.count_nonzero(~(apart <= CLOCKS_S)))
    if not bad:
        return []
    return [
        Flag(
            "clocks_disagree",
            f"The card's clock is not that of rigd in {bad} of {len(apart)} samples (apart by more "
            f"than {1e3 * CLOCKS_S:.0f} ms, or no number): another rate than the card was set to, "
            "or samples were lost.",
        )
    ]


def _rails(signals: Signals, card: Rows) -> list[Flag]:
    """Return a flag if inputs stood at an end of their range: bit i is of the i-th input.

    As for volts (:mod:`.flags`), samples up to the stop count, and single ones are spikes.
    """
    if not signals.card.has_status or not len(card):
        return []
    inputs = [channel.name for channel in signals.card.channels if channel.raw_of is not None]
    at_end = []
    for name, field in signals.fields.items():
        if field not in inputs:
            continue
        count = int(np.count_nonzero(card[STATUS_FIELD] & (1 << inputs.index(field))))
        if count >= AT_END_SAMPLES:
            at_end.append(f"{name} in {count} of {len(card)} samples")
    if not at_end:
        return []
    return [
        Flag(
            "at_rail",
            "The card reports inputs at an end of their range up to the stop: "
            f"{', '.join(at_end)}.",
        )
    ]


def _scale_kg(
    sweep: RecordedSweep, trial: TrialInfo, signals: Signals, drive: _Drive
) -> tuple[float, bool]:
    """Return the mass that the scale showed at rest before the start, and whether it was at rest.

    That is the mean of its last readings in a row that it called stable: earlier ones may be of
    the weights before. NaN if there is none of the last :data:`REST_NS`. A scale without a
    status word cannot report that it is not at rest: its last reading counts as if it were.
    """
    end = drive.start_ns if drive.start_ns is not None else trial.end_ns
    rows = sweep.recording.read(signals.scale, trial.start_ns, end)
    if not sweep.recording.streams[signals.scale].has_status:
        return (float(rows[signals.mass][-1]) if len(rows) else float("nan")), True
    rows = rows[rows[STATUS_FIELD] & STALE == 0]
    if not len(rows):
        return float("nan"), True
    stable = (rows[STATUS_FIELD] & STABLE) != 0
    at_rest = np.flatnonzero(stable)
    if not len(at_rest) or rows[TIME_FIELD][-1] - rows[TIME_FIELD][at_rest[-1]] > REST_NS:
        return float("nan"), False
    last = int(at_rest[-1])
    moving = np.flatnonzero(~stable[:last])
    first = int(moving[-1]) + 1 if len(moving) else 0
    return float(np.mean(rows[signals.mass][first : last + 1])), True


def _set_name(sweep: RecordedSweep, trial: TrialInfo) -> str:
    return ", ".join(sweep.parameter(trial, name) for name in sweep.plan.group_by or ("set",))


def _wheel(sweep: RecordedSweep, trial: TrialInfo) -> str:
    """Return the wheel that the answer names, else the one that was planned; "" for none."""
    answer = trial.answers.get("wheel", trial.parameters.get("wheel"))
    return str(answer) if answer is not None else sweep.info.parameters.get("wheel", "")


def _label(sweep: RecordedSweep, trial: TrialInfo) -> str:
    words = [sweep.parameter(trial, name) for name in ("load", "voltage")]
    return ", ".join([_set_name(sweep, trial), *words, f"repeat {trial.repeat or 1}"])


def _number(sweep: RecordedSweep, trial: TrialInfo, name: str) -> float:
    value = trial.parameters.get(name)
    if not _is_number(value):
        raise DataError(
            f"{sweep.path}: trial {trial.number} has no quantity {name!r}",
            hint="the sweep of an approach-angle campaign has set, load and voltage",
        )
    return float(value)


def telling_attempts(trials: Sequence[TrialInfo]) -> list[TrialInfo]:
    """Return one attempt at each trial: the last complete one, else the last one."""
    last: dict[int, TrialInfo] = {}
    for trial in trials:
        known = last.get(trial.number)
        if known is None or trial.complete or not known.complete:
            last[trial.number] = trial
    return [last[number] for number in sorted(last)]
