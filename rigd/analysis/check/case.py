"""Holds trials simulated from known parameters and writes them as the recording of a rig."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.analysis import Analysis
from rigd.analysis.calibration import ATTACHMENT
from rigd.model.channels import Channel, Stream
from rigd.model.rows import TIME_FIELD, row_dtype
from rigd.record import Attachment, RecordingWriter
from rigd.sdk.analysis import ANY_UNIT, choices

#: The device that gives all signals of a case.
DEVICE: Final = "bench"
_START_NS: Final = 1_790_000_000_000_000_000
_PAUSE_NS: Final = 1_000_000_000


@dataclass(frozen=True, eq=False)
class SimulatedTrial:
    """What one trial records: (n,) times in s, evenly spaced, and (n,) signals in SI by name.

    ``steps`` are those of its procedure that the analysis reads by their names, each with the time
    in s at which it begins; it ends when the next one begins. ``channels`` are recorded beside the
    signals and stand in no plan, such as the setpoint that a signal is the reading of: (n,) values
    without unit.
    """

    t_s: NDArray[np.float64]
    signals: Mapping[str, NDArray[np.float64]]
    parameters: Mapping[str, float | str] = field(default_factory=dict)
    steps: Mapping[str, float] = field(default_factory=dict)
    channels: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Case:
    """Trials with the values that are known of them.

    A constant is a number in SI or, if it differs from trial to trial, the name of the parameter of
    the trials that holds it. ``truth`` are the parameters that they were simulated from, which must
    be found; ``unknown`` those that they cannot hold, of which no number may be quoted.
    ``symbols`` are those by which the report calls what is found, by name.
    ``calibration`` is the text of a calibration file, for an analysis that needs one. ``units`` are
    those of signals that may be of several kinds, if not the first.
    """

    trials: Sequence[SimulatedTrial]
    constants: Mapping[str, float | str]
    truth: Mapping[str, float]
    unknown: tuple[str, ...] = ()
    calibration: str = ""
    symbols: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)


def write_case(
    path: Path,
    analysis: type[Analysis],
    case: Case,
    *,
    complete: bool = True,
    model: str = "case",
    numbers: Sequence[int] = (),
    displayed: bool = False,
) -> Path:
    """Write the trials of ``case`` as one recording, whose plan is that of ``analysis``.

    Without ``complete`` no trial comes to its end. ``model`` is the name in the plan. The trials
    have ``numbers``, from 1 on by default. If ``displayed``, people read the channels in
    thousandths of their units; the samples are the same.

    Raises:
        ValueError: the trials have different signals or channels, or no signal.
    """
    names, beside = list(case.trials[0].signals), list(case.trials[0].channels)
    if not names or any(
        (list(trial.signals), list(trial.channels)) != (names, beside) for trial in case.trials
    ):
        raise ValueError("all trials of a case have the same signals, one at least, and channels")
    declared = {**analysis.needs.signals, **analysis.needs.optional_signals}
    units = {
        name: "1" if unit == ANY_UNIT else choices(unit)[0] for name, unit in declared.items()
    } | dict(case.units)
    recorded = (_channel(name, units.get(name, "1"), displayed) for name in (*names, *beside))
    stream = Stream(DEVICE, tuple(recorded))
    plan = {
        "model": model,
        "signals": json.dumps({name: f"{DEVICE}.{name}" for name in names}),
        "constants": json.dumps(dict(case.constants)),
        "group_by": "[]",
    }
    run = {
        "procedure": model,
        "rig": "case",
        "seed": "1",
        "trials": str(len(case.trials)),
        "started": datetime.fromtimestamp(_START_NS * 1e-9, UTC).isoformat(),
    }
    text = case.calibration.encode()
    attached = (Attachment(ATTACHMENT, "application/yaml", text),) if text else ()
    with RecordingWriter.create(
        path,
        streams=[stream],
        metadata={"run": run, "parameters": {}, "identify": plan},
        attachments=attached,
        start_ns=_START_NS,
        sync_interval_s=None,
    ) as writer:
        begin_ns = _START_NS
        numbers = numbers or range(1, len(case.trials) + 1)
        for number, trial in zip(numbers, case.trials, strict=True):
            begin_ns = _write_trial(writer, stream, number, begin_ns, trial, complete=complete)
        reason = "all trials played" if complete else "stopped"
        state = "complete" if complete else "stopped"
        writer.event(begin_ns, "run_end", -1, {"state": state, "reason": reason})
    return path


def _channel(name: str, unit: str, displayed: bool) -> Channel:
    if displayed:
        with suppress(ValueError):  # it has no thousandths
            return Channel(name, unit, display=f"m{unit}")
    return Channel(name, unit)


def _write_trial(
    writer: RecordingWriter,
    stream: Stream,
    number: int,
    begin_ns: int,
    trial: SimulatedTrial,
    *,
    complete: bool,
) -> int:
    """Write one trial; return when the next one begins, in ns."""
    rows = np.zeros(len(trial.t_s), row_dtype(stream))
    times_ns = np.rint((trial.t_s - trial.t_s[0]) * 1e9).astype(np.int64)
    rows[TIME_FIELD] = begin_ns + times_ns
    for name, values in (*trial.signals.items(), *trial.channels.items()):
        rows[name] = values
    about = {"number": number, "repeat": 1, "parameters": dict(trial.parameters), "units": {}}
    writer.event(begin_ns, "trial_start", number, about)
    for name, begin_s in trial.steps.items():
        step_ns = begin_ns + round((begin_s - trial.t_s[0]) * 1e9)
        writer.event(step_ns, "step", number, {"name": name})
    writer.write(stream.name, rows)
    end_ns = int(rows[TIME_FIELD][-1]) + 1
    writer.event(end_ns, "trial_end", number, {"complete": complete, "reason": ""})
    return end_ns + _PAUSE_NS
