"""Reads how far platform and wheel went beyond the stop of a run.

The relay has no brake. The overshoot is the travel beyond the threshold when the relay is commanded
to open: the newest block of samples is some milliseconds old by then. The final travel is where
the platform comes to rest, at its bumper or before (angle.md 4.6 asks for both).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.recordings.source import TIME_FIELD, RecordedSweep, Stream, TrialInfo
from rigd_analyses.approach_angle.raw.run_data import RunOn

#: The stop is judged by the samples so long around it, s: noise of the potentiometer is 0.3 mm.
AROUND_S: Final = 0.01
#: What was recorded ends with so long a rest, s, in which neither moves by more than this.
REST_S: Final = 0.05
REST_M: Final = 0.002
REST_RAD: Final = 0.1

Rows = NDArray[np.void]


def read_run_on(
    sweep: RecordedSweep,
    trial: TrialInfo,
    card: Rows,
    fields: Mapping[str, str],
    stream: Stream,
    stop_ns: int | None,
) -> RunOn:
    """Return how far ``trial`` went beyond its stop; NaN for all that was not recorded.

    ``card`` are its rows, ``fields`` the channels of the raw signals in ``stream``.
    """
    if stop_ns is None:
        return RunOn()
    travel, speed = _at_stop(card, fields, stream, stop_ns)
    farthest, _, still = _final(sweep, trial, "final_travel", stop_ns, REST_M)
    _, turned, stopped = _final(sweep, trial, "final_turning", stop_ns, REST_RAD)
    return RunOn(
        stop_travel_m=travel,
        stop_speed_m_s=speed,
        threshold_m=_constant(sweep, trial, "stop_travel"),
        final_travel_m=farthest,
        final_turning_rad=turned,
        turning_limit_rad=_constant(sweep, trial, "most_turning"),
        at_rest=still and stopped,
    )


def _constant(sweep: RecordedSweep, trial: TrialInfo, name: str) -> float:
    return sweep.constant(trial, name) if name in sweep.plan.constants else math.nan


def _at_stop(
    card: Rows, fields: Mapping[str, str], stream: Stream, stop_ns: int
) -> tuple[float, float]:
    """Return travel and speed at the stop, by a straight line through the samples around it."""
    raw = fields["platform_position"]
    converted = next((item.raw_of for item in stream.channels if item.name == raw), None)
    if converted is None or converted not in (card.dtype.names or ()):
        return math.nan, math.nan
    since_s = (card[TIME_FIELD] - stop_ns) * 1e-9
    near = np.abs(since_s) <= AROUND_S
    t, travel = since_s[near], card[converted][near]
    whole = np.count_nonzero(near) >= 3 and np.ptp(t) > 0.0
    if not whole or not np.all(np.isfinite(travel)) or t[0] > 0.0 or t[-1] < 0.0:
        return math.nan, math.nan
    speed, at_stop = (float(value) for value in np.polyfit(t, travel, 1))
    return at_stop, speed


def _final(
    sweep: RecordedSweep, trial: TrialInfo, signal: str, stop_ns: int, still: float
) -> tuple[float, float, bool]:
    """Return the largest and the last value behind the stop, and whether it was at rest then."""
    if signal not in sweep.plan.signals:
        return math.nan, math.nan, False
    stream, field = sweep.field(signal)
    rows = sweep.recording.read(stream.name, stop_ns, trial.end_ns)
    known = rows[np.isfinite(rows[field])]
    values = known[field]
    if len(values) < 2:
        return math.nan, math.nan, False
    times = known[TIME_FIELD]
    last = values[times >= times[-1] - round(REST_S * 1e9)]
    return float(np.max(values)), float(np.mean(last)), len(last) > 1 and np.ptp(last) <= still
