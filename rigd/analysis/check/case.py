"""Trials simulated from known parameters, and the recording that a rig would make of them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.analysis import Analysis
from rigd.analysis.calibration import ATTACHMENT
from rigd.model.channels import Channel, Stream
from rigd.model.rows import TIME_FIELD, row_dtype
from rigd.record import Attachment, RecordingWriter

#: The device that gives all signals of a case.
DEVICE: Final = "bench"
_START_NS: Final = 1_790_000_000_000_000_000
_PAUSE_NS: Final = 1_000_000_000


@dataclass(frozen=True, eq=False)
class SimulatedTrial:
    """What one trial records: (n,) times in s, evenly spaced, and (n,) signals in SI by name."""

    t_s: NDArray[np.float64]
    signals: Mapping[str, NDArray[np.float64]]
    parameters: Mapping[str, float | str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Case:
    """Trials with what is known of them.

    ``truth`` are the parameters that they were simulated from, which must be found; ``unknown``
    those that they cannot hold, of which no number may be quoted. ``calibration`` is the text of
    a calibration file, for an analysis that needs one.
    """

    trials: Sequence[SimulatedTrial]
    constants: Mapping[str, float]
    truth: Mapping[str, float]
    unknown: tuple[str, ...] = ()
    calibration: str = ""


def write_case(
    path: Path, analysis: type[Analysis], case: Case, *, complete: bool = True, model: str = "case"
) -> Path:
    """Write the trials of ``case`` as one recording, whose plan is that of ``analysis``.

    Without ``complete`` no trial comes to its end. ``model`` is the name in the plan.

    Raises:
        ValueError: the trials have different signals, or none of them.
    """
    names = list(case.trials[0].signals)
    if not names or any(list(trial.signals) != names for trial in case.trials):
        raise ValueError("all trials of a case have the same signals, one at least")
    units = {**analysis.needs.signals, **analysis.needs.optional_signals}
    stream = Stream(DEVICE, tuple(Channel(name, units.get(name, "1")) for name in names))
    plan = {
        "model": model,
        "signals": json.dumps({name: f"{DEVICE}.{name}" for name in names}),
        "constants": json.dumps(dict(case.constants)),
        "group_by": "[]",
    }
    run = {"procedure": model, "rig": "case", "seed": "1", "trials": str(len(case.trials))}
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
        for number, trial in enumerate(case.trials, start=1):
            begin_ns = _write_trial(writer, stream, number, begin_ns, trial, complete=complete)
        reason = "all trials played" if complete else "stopped"
        state = "complete" if complete else "stopped"
        writer.event(begin_ns, "run_end", -1, {"state": state, "reason": reason})
    return path


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
    for name, values in trial.signals.items():
        rows[name] = values
    about = {"number": number, "repeat": 1, "parameters": dict(trial.parameters), "units": {}}
    writer.event(begin_ns, "trial_start", number, about)
    writer.write(stream.name, rows)
    end_ns = int(rows[TIME_FIELD][-1]) + 1
    writer.event(end_ns, "trial_end", number, {"complete": complete, "reason": ""})
    return end_ns + _PAUSE_NS
