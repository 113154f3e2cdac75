"""Reads the measures of one trial off its samples."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.measures.events import Samples, event_time, holding, holds_at
from rigd.analysis.measures.mean import mean_of
from rigd.analysis.measures.ranges import Sensors
from rigd.analysis.measures.result import TrialReading
from rigd.computed.derived.driver import DERIVED
from rigd.model.channels import STATUS_FIELD
from rigd.model.rows import TIME_FIELD
from rigd.procedure.conditions.condition_text import describe_until, describe_window
from rigd.procedure.program import Condition, Measure, Window
from rigd.record import Event, Recording, TrialInfo
from rigd.record.events.trials import Step, held
from rigd.record.read.resample import stale_rows


class Unread(Exception):
    """A measure cannot be read; the text is the reason."""


Events = Sequence[Sequence[Condition]]


@dataclass(frozen=True)
class PlayedSteps:
    """The steps of a recording that may be measured, by trial, and the events of pauses.

    ``stepped`` are the trials with any step: an imported trial has none.
    """

    steps: Mapping[int, Sequence[Step]]
    pauses: Sequence[Event]
    stepped: Collection[int]

    @classmethod
    def of(cls, recording: Recording, names: Collection[str]) -> Self:
        """Return those of ``recording`` with these ``names``."""
        steps: dict[int, list[Step]] = {}
        for step in recording.steps:
            if step.name in names:
                steps.setdefault(step.trial, []).append(step)
        pauses = [event for event in recording.all_events if event.kind == "hold"]
        return cls(steps, pauses, {step.trial for step in recording.steps})


@dataclass(eq=False)
class TrialReader:
    """Reads one trial of a recording."""

    recording: Recording
    trial: TrialInfo
    played: PlayedSteps
    sensors: Sensors
    _rows: dict[tuple[str, int, int], NDArray[Any]] = field(default_factory=dict)

    def reading(self, measure: Measure) -> TrialReading:
        """Return ``measure`` of this trial, or the reason why it cannot be read."""
        path, number, start_ns = self.recording.path, self.trial.number, self.trial.start_ns
        try:
            if not self.trial.complete:
                why = self.trial.lost or self.trial.reason or "it has no end"
                raise Unread(f"the trial is not complete: {why}")
            if paused := held(self.played.pauses, self.trial):
                raise Unread(f"the trial was {paused}")
            span = self._between(measure.window, self._span(measure.window))
            if measure.kind == "mean":
                _, values = self._values(measure, span)
                mean = mean_of(values, rounded=self.sensors.rounds(measure.channel))
                return TrialReading(
                    path, number, mean.value, mean.u, note=mean.reason, start_ns=start_ns,
                    hidden=mean.hidden,
                )  # fmt: skip
            return TrialReading(path, number, self._value(measure, span), start_ns=start_ns)
        except Unread as error:
            return TrialReading(path, number, None, reason=str(error), start_ns=start_ns)

    def _value(self, measure: Measure, span: tuple[int, int]) -> float:
        if measure.kind == "channel":
            at = self._event(measure.when, span, self._seconds(span[0]))
            return self._at(measure.channel, span, at)
        if measure.kind == "duration":
            begin = self._seconds(span[0])
            if measure.since:
                begin = self._event(measure.since, span, begin)
            return self._event(measure.when, span, begin) - begin
        times, values = self._values(measure, span)
        with np.errstate(over="ignore", invalid="ignore"):
            found = _STATISTICS[measure.kind](times, values)
        if not np.isfinite(found):
            raise Unread(
                f"samples up to {np.max(np.abs(values)):.3g} are too large to compute with"
            )
        return found

    def _seconds(self, t_ns: int) -> float:
        return (t_ns - self.trial.start_ns) * 1e-9

    def _span(self, window: Window) -> tuple[int, int]:
        """Return begin and end of a window in ns.

        Raises:
            Unread: its step was not played, or not for so long.
        """
        begin_ns, end_ns, name = self._bounds(window)
        lasted_s = (end_ns - begin_ns) * 1e-9
        needed_s = window.last_s if window.last_s is not None else window.end_s
        if np.isfinite(needed_s) and needed_s > lasted_s + 1e-6:
            raise Unread(f"{name} lasted {lasted_s:.4g} s, not {needed_s:g} s")
        if window.last_s is not None:
            return end_ns - round(window.last_s * 1e9), end_ns
        if np.isfinite(window.end_s):
            end_ns = begin_ns + round(window.end_s * 1e9)
        return begin_ns + round(window.begin_s * 1e9), end_ns

    def _bounds(self, window: Window) -> tuple[int, int, str]:
        """Return begin and end of the step of a window in ns, all steps if None, and its name.

        Raises:
            Unread: its step was not played.
        """
        played = [step for step in self._played() if window.step in (None, step.name)]
        if not played and window.step is None and self.trial.number not in self.played.stepped:
            return self.trial.start_ns, self.trial.end_ns or self.recording.end_ns, "the trial"
        if not played:
            raise Unread(self._not_played(window))
        name = "the steps" if window.step is None else f"step {window.step!r}"
        begin_ns = played[0].start_ns
        return begin_ns, max(step.end_ns or begin_ns for step in played), name

    def _between(self, window: Window, span: tuple[int, int]) -> tuple[int, int]:
        """Return the part of a span from one event of a window to the other.

        Raises:
            Unread: one of them does not come.
        """
        begin_ns, end_ns = span
        if window.since:
            at_s = self._event(window.since, span, self._seconds(begin_ns), window.nth)
            begin_ns = self.trial.start_ns + round(at_s * 1e9)
        if window.until:
            at_s = self._event(window.until, span, self._seconds(begin_ns))
            end_ns = self.trial.start_ns + round(at_s * 1e9)
        return begin_ns, end_ns

    def _not_played(self, window: Window) -> str:
        if self.trial.number not in self.played.stepped:
            return (
                f"the trial has no steps, so no {window.step!r}: without 'during' all of it "
                "counts; write 'during: 1 s to 3 s', or '{from: CONDITION, to: CONDITION}'"
            )
        words = "no step of the procedure was played"
        return words if window.step is None else f"step {window.step!r} was not played"

    def _played(self) -> list[Step]:
        end_ns = self.trial.end_ns or self.recording.end_ns
        return [
            step
            for step in self.played.steps.get(self.trial.number, ())
            if self.trial.start_ns <= step.start_ns < end_ns
        ]

    def _samples(self, name: str, span: tuple[int, int]) -> Samples:
        """Return times in s since the trial began (n,) and values (n,), without repeated rows.

        While the rig waited at a prompt no step was played: these rows do not count.
        """
        stream, _, channel = name.partition(".")
        key = (stream, *span)
        if key not in self._rows:
            rows = self.recording.read(stream, *span)
            if self.recording.streams[stream].has_status:
                rows = rows[~stale_rows(rows[STATUS_FIELD])]
            self._rows[key] = self._in_steps(rows)
        rows = self._rows[key]
        seconds = (rows[TIME_FIELD].astype(np.int64) - self.trial.start_ns).astype(
            np.float64
        ) * 1e-9
        return seconds, rows[channel].astype(np.float64)

    def _in_steps(self, rows: NDArray[Any]) -> NDArray[Any]:
        """Return the rows within a step that was played; all rows of a trial without steps."""
        played = self._played()
        if not played:
            return rows
        times = rows[TIME_FIELD].astype(np.int64)
        inside = np.zeros(len(rows), bool)
        for step in played:
            end_ns = self.recording.end_ns + 1 if step.end_ns is None else step.end_ns
            inside |= (step.start_ns <= times) & (times < end_ns)
        return rows[inside]

    def _values(self, measure: Measure, span: tuple[int, int]) -> Samples:
        """Return the samples of the channel of a measure.

        Raises:
            Unread: there is none, or one is not finite: it might be the one that counts.
        """
        holds = measure.window.holds
        times, values = self._held(measure.channel, span, holds)
        if not len(values):
            raise Unread(f"no sample of {measure.channel} in {describe_window(measure.window)}")
        if missing := int((~np.isfinite(values)).sum()):
            raise Unread(
                f"{missing} of {len(values)} samples of {measure.channel} have no value"
                f"{self._left_out(measure.channel)}"
            )
        least = _LEAST.get(measure.kind, 1)
        if len(values) < least:
            raise Unread(f"{len(values)} sample of {measure.channel}: {least} are needed")
        self._refuse_saturated(measure.channel, span, holds=holds)
        return times, values

    def _held(self, name: str, span: tuple[int, int], rows: Events) -> Samples:
        """Return the samples of a channel at which one of ``rows`` holds; all without any."""
        times, values = self._samples(name, span)
        if not rows:
            return times, values
        inside = np.zeros(len(times), bool)
        for begin, end in holding(rows, lambda channel: self._samples(channel, span)):
            inside |= (begin < times) & (times < end)
        return times[inside], values[inside]

    def _left_out(self, name: str) -> str:
        """Return why samples of a derived channel usually have no value, and what to do."""
        if self.recording.streams[name.partition(".")[0]].source != DERIVED:
            return ""
        return (
            ": a derived channel has none while its `where` does not hold; measure a part of the "
            "trial in which it holds, or write 'hold(x, condition)' into its formula"
        )

    def _refuse_saturated(
        self, name: str, span: tuple[int, int], at_s: float | None = None, holds: Events = ()
    ) -> None:
        """Check the sensors behind a channel, in a whole span or in the samples about a time.

        Raises:
            Unread: a value at the end of a range stands for all that lie beyond it.
        """
        for sensor in self.sensors.behind(name):
            times, values = self._held(sensor.name, span, holds)
            if at_s is not None:
                after = int(np.searchsorted(times, at_s))
                values = values[max(after - 1, 0) : after + 1]
            count, words = sensor.end(values)
            if count:
                raise Unread(f"{count} of {len(values)} samples have {words}")

    def _event(self, rows: Events, span: tuple[int, int], begin_s: float, number: int = 1) -> float:
        """Return when a condition begins to hold after ``begin_s``, in s since the trial began.

        Raises:
            Unread: it never does, or not so often.
        """

        def samples(name: str) -> Samples:
            return self._samples(name, span)

        at = event_time(rows, samples, begin_s, number)
        if at is not None:
            return at
        text = describe_until(tuple(tuple(row) for row in rows))
        if number > 1:
            raise Unread(f"{text} did not begin to hold {number} times")
        if holds_at(rows, samples, begin_s):
            raise Unread(f"{text} holds already at the beginning, and does not begin again")
        raise Unread(f"{text} never came")

    def _at(self, name: str, span: tuple[int, int], at_s: float) -> float:
        """Return the value of a channel at a time, on the line between its two samples.

        Raises:
            Unread: there is no sample before and after, or one of the two is not finite.
        """
        times, values = self._samples(name, span)
        after = int(np.searchsorted(times, at_s))
        if after < len(times) and times[after] == at_s:
            pair = [after, after]
        elif 0 < after < len(times):
            pair = [after - 1, after]
        else:
            raise Unread(f"no sample of {name} before and after the event")
        if not np.isfinite(values[pair]).all():
            raise Unread(f"{name} has no value at the event")
        self._refuse_saturated(name, span, at_s)
        return float(np.interp(at_s, times[pair], values[pair]))


def _slope(times: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Return the slope of the line of least squares, per second."""
    centred = times - times.mean()
    return float(np.dot(centred, values - values.mean()) / np.dot(centred, centred))


def _rms(values: NDArray[np.float64]) -> float:
    """Return the root mean square; the squares of extreme values would be no numbers."""
    scale = float(np.max(np.abs(values)))
    return scale * float(np.sqrt(np.mean((values / scale) ** 2))) if scale else 0.0


def _std(values: NDArray[np.float64]) -> float:
    return _rms(values - values.mean()) * float(np.sqrt(len(values) / (len(values) - 1)))


_Statistic = Callable[[NDArray[np.float64], NDArray[np.float64]], float]
_STATISTICS: dict[str, _Statistic] = {
    "max": lambda times, values: float(values.max()),
    "min": lambda times, values: float(values.min()),
    "peak_to_peak": lambda times, values: float(np.ptp(values)),
    "rms": lambda times, values: _rms(values),
    "std": lambda times, values: _std(values),
    "slope": _slope,
    "final": lambda times, values: float(values[-1]),
}
#: Samples that a statistic needs, if more than one.
_LEAST = {"std": 2, "slope": 2}
