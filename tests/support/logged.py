"""A recording of one trial from tables that loggers of their own wrote, each with its times."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.recordings.source import RecordedSweep, open_sweep
from rigd.model.channels import Channel, Stream
from rigd.model.rows import TIME_FIELD, row_dtype
from rigd.record import RecordingWriter

START_NS = 1_790_000_000_000_000_000

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LoggedTable:
    """Times in s (n,), which may be uneven, and columns (n,) with their units, in SI."""

    t_s: FloatArray
    columns: Mapping[str, tuple[str, FloatArray]]


def logged(path: Path, tables: Mapping[str, LoggedTable], model: str) -> RecordedSweep:
    """Write ``tables`` as streams to ``path``; each column is the signal of its name."""
    streams = {
        name: Stream(name, tuple(Channel(key, unit) for key, (unit, _) in table.columns.items()))
        for name, table in tables.items()
    }
    signals = {key: f"{name}.{key}" for name, table in tables.items() for key in table.columns}
    plan = {
        "model": model, "signals": json.dumps(signals), "constants": "{}", "group_by": "[]",
    }  # fmt: skip
    begin = START_NS + round(1e9 * min(table.t_s[0] for table in tables.values()))
    end = START_NS + round(1e9 * max(table.t_s[-1] for table in tables.values())) + 1
    run = {"procedure": "logged", "rig": "bench", "trials": "1"}
    with RecordingWriter.create(
        path, streams=list(streams.values()), metadata={"run": run, "identify": plan},
        attachments=(), start_ns=begin, sync_interval_s=None,
    ) as writer:  # fmt: skip
        writer.event(begin, "trial_start", 1, {})
        for name, table in tables.items():
            rows = np.zeros(len(table.t_s), row_dtype(streams[name]))
            rows[TIME_FIELD] = START_NS + np.rint(table.t_s * 1e9).astype(np.int64)
            for key, (_, values) in table.columns.items():
                rows[key] = values
            writer.write(name, rows)
        writer.event(end, "trial_end", 1, {"complete": True})
        writer.event(end, "run_end", -1, {"state": "complete", "reason": "all trials played"})
    return open_sweep(path)
