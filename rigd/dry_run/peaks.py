"""Keeps the extremes of every channel and the times of every step during a dry run.

The dry run writes its rows to this sink instead of a recording.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rigd.dry_run.at_limit import AtLimit
from rigd.dry_run.swings import Swings
from rigd.dry_run.wrong_sign import Departures
from rigd.engine.sink import Rows
from rigd.model.channels import STATUS_FIELD
from rigd.model.rows import TIME_FIELD


@dataclass
class PeakSink:
    """Keeps extremes of a run; ``peaks`` maps ``stream.field`` to (lowest, highest) in SI.

    ``steps`` has (time in ns, trial number, step name) in order of play. ``swings``,
    ``at_limit`` and ``departures`` have the streams of the controllers.
    """

    peaks: dict[str, tuple[float, float]] = field(default_factory=dict)
    steps: list[tuple[int, int, str]] = field(default_factory=list)
    trips: list[str] = field(default_factory=list)
    cut: set[str] = field(default_factory=set)
    swings: Mapping[str, Swings] = field(default_factory=dict)
    at_limit: Mapping[str, AtLimit] = field(default_factory=dict)
    departures: Mapping[str, Departures] = field(default_factory=dict)
    last_ns: int = 0

    def write(self, stream: str, rows: Rows) -> None:
        """Update the extremes with ``rows``; NaN is skipped."""
        self.last_ns = max(self.last_ns, int(rows[TIME_FIELD][-1]))
        if stream in self.swings:
            self.swings[stream].take(rows)
        if stream in self.at_limit:
            self.at_limit[stream].take(rows)
        if stream in self.departures:
            self.departures[stream].take(rows)
        for name in rows.dtype.names or ():
            if name in (TIME_FIELD, STATUS_FIELD):
                continue
            column = rows[name]
            low, high = float(np.fmin.reduce(column)), float(np.fmax.reduce(column))
            known = self.peaks.get(f"{stream}.{name}", (low, high))
            self.peaks[f"{stream}.{name}"] = (
                float(np.fmin(known[0], low)),
                float(np.fmax(known[1], high)),
            )

    def event(self, t_ns: int, kind: str, trial: int, data: Mapping[str, object]) -> None:
        """Keep steps, trips and limited setpoints."""
        if kind == "step":
            self.steps.append((t_ns, trial, str(data["name"])))
        elif kind == "interlock" and data["action"] != "warn":
            self.trips.append(f"interlock {data['name']} ({data['action']}): {data['reason']}")
        elif kind == "limit":
            names = data["setpoints"]
            self.cut.update(names if isinstance(names, list) else ())

    def flush(self, *, complete: bool = False) -> None:
        """Do nothing: nothing is stored on disk."""

    def close(self) -> None:
        """Do nothing: nothing is open."""
