"""Opens a recording for an analysis: gives its plan, its trials, and signals at common times.

The plan is the `identify` block of the procedure that was recorded: it names the model, the
recorded channel of each signal, and the known constants. A trial is one point of the procedure's
sweep (its list of parameter values), played once. The signals of a trial come from several devices
with different sampling times; the module brings them all to the times of the slowest one. Damaged
parts of a recording are passed over.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from shlex import quote
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from rigd.config.document import parse_document
from rigd.model.channels import STALE, STATUS_FIELD, Stream
from rigd.model.errors import ConfigError, DataError
from rigd.model.rows import TIME_FIELD
from rigd.model.units import Quantity, parse_unit
from rigd.procedure.program import IdentifyPlan
from rigd.record import Event, Recording, RunInfo, TrialInfo
from rigd.record.events.trials import held
from rigd.record.read.info import COMPLETE
from rigd.record.read.resample import (
    LONGEST_STEP,
    SamplingRule,
    bridge,
    brought,
    grid,
    means_around,
    on_grid,
    period_ns,
    stale_rows,
)
from rigd.sdk.analysis import choices

#: Here also what the author of an analysis needs of recordings as such.
__all__ = [
    "COMPLETE",
    "STALE",
    "STATUS_FIELD",
    "TIME_FIELD",
    "Event",
    "FloatArray",
    "RecordedSweep",
    "Recording",
    "RunInfo",
    "Stream",
    "TrialInfo",
    "Unusable",
    "open_sweep",
    "period_ns",
    "stale_rows",
]

FloatArray = NDArray[np.float64]

#: What of a recorded plan is text; all else is JSON.
_TEXTS: Final = ("model", "reference_label")


class Unusable(DataError):
    """Too many samples of one trial are missing or late; other trials may be usable."""


@dataclass(frozen=True)
class Correction:
    """A part of the plan that differs from the recorded one; both as text for a reader."""

    recording: Path
    what: str  #: the name of a constant, or `signal NAME`
    recorded: str  #: "" if the recording has none
    used: str

    def __str__(self) -> str:
        return f"{self.recorded or 'nothing'} in the recording, {self.used or 'nothing'} here"


@dataclass(frozen=True, eq=False)
class TrialRows:
    """Signals of a trial at the rows of one stream, (n,): time in s since the trial began, SI.

    ``rules`` are sentences on how each came there that is not of that stream, and on rows that had
    to be left out. ``curved`` are the signals that lie on straight lines between samples, without
    the error of these; what differs belongs into the budget.
    """

    t_s: FloatArray
    signals: Mapping[str, FloatArray]
    rules: tuple[str, ...] = ()
    curved: Mapping[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True)
class RecordedSweep:
    """One recording with its plan of identification.

    ``corrections`` are the parts of ``plan`` that the recording has otherwise.
    """

    recording: Recording
    info: RunInfo
    plan: IdentifyPlan
    corrections: tuple[Correction, ...] = ()

    @property
    def path(self) -> Path:
        """The file."""
        return self.recording.path

    @property
    def trials(self) -> tuple[TrialInfo, ...]:
        """The trials that were completed, in the order of the sweep."""
        complete = [trial for trial in self.info.trials if trial.complete]
        return tuple(sorted(complete, key=lambda trial: trial.number))

    def parameter(self, trial: TrialInfo, name: str) -> str:
        """Return a parameter of ``trial`` as a person writes it.

        Raises:
            DataError: neither the trial nor the run has it.
        """
        if name in trial.parameters:
            value, unit = trial.parameters[name], trial.units.get(name)
            number = isinstance(value, int | float) and not isinstance(value, bool)
            return str(Quantity(value, parse_unit(unit))) if number and unit else str(value)
        if name in self.info.parameters:
            return self.info.parameters[name]
        raise DataError(f"{self.path}: there is no parameter {name!r} to group by")

    def constant(self, trial: TrialInfo, name: str) -> float:
        """Return a known quantity of the model in SI, as it was in ``trial``.

        Raises:
            DataError: the plan does not have it, or it follows a parameter the trial lacks.
        """
        value = self.plan.constants.get(name)
        if isinstance(value, str):  # it follows a swept parameter
            value = trial.parameters.get(value)
        if not isinstance(value, int | float):
            raise DataError(
                f"{self.path}: the constant {name!r} is not known",
                hint="give it under `identify: constants:` in the procedure",
            )
        return float(value)

    def uncertainty(self, trial: TrialInfo, name: str) -> float | None:
        """Return the standard uncertainty of :meth:`constant` in SI; None if none is given.

        Raises:
            DataError: as :meth:`constant`.
        """
        value, u = self.constant(trial, name), self.plan.uncertainties.get(name)
        return None if u is None else u.of(value)

    def reference(self, trial: TrialInfo) -> dict[str, float]:
        """Return the published values of the model's parameters that belong to ``trial``."""
        choices = {value for value in trial.parameters.values() if isinstance(value, str)}
        return {
            name.rpartition(".")[2]: value
            for name, value in self.plan.reference.items()
            if "." not in name or name.rpartition(".")[0] in choices
        }

    def without(self, optional: Collection[str]) -> RecordedSweep:
        """Return the sweep without those of the ``optional`` signals whose stream is not there."""
        missing = {
            name
            for name in optional
            if name in self.plan.signals
            and self.plan.signals[name].partition(".")[0] not in self.recording.streams
        }
        if not missing:
            return self
        kept = {name: at for name, at in self.plan.signals.items() if name not in missing}
        return replace(self, plan=replace(self.plan, signals=kept))

    def signals(self, trial: TrialInfo) -> tuple[FloatArray, dict[str, FloatArray]]:
        """Return time in s since the trial began (n,) and every signal of the plan (n,), SI.

        All stand at regular times, those of the slowest stream. One with other times must be
        sampled at least twice as fast: it is brought there by the mean of its samples within half
        a period around each. A few samples that are missing, or repeat an earlier one as the
        device was late, are bridged by straight lines (see :meth:`bridged`).

        Raises:
            DataError: a stream or channel that the plan names is not in the recording.
            Unusable: too many samples of this trial are missing or late.
        """
        times, columns, _ = self.signals_and_faster(trial)
        return times, columns

    def signals_and_faster(
        self, trial: TrialInfo
    ) -> tuple[FloatArray, dict[str, FloatArray], dict[str, FloatArray]]:
        """Return :meth:`signals`, and the samples (m,) that those of faster streams are means of.

        Raises:
            DataError: as :meth:`signals`.
            Unusable: as :meth:`signals`.
        """
        plan = {name: self.field(name) for name in self.plan.signals}
        if not plan:
            raise DataError(f"{self.path}: its plan of identification names no signals")
        rows = {stream.name: self._rows(stream.name, trial) for stream, _ in plan.values()}
        slowest = min(rows, key=lambda name: len(rows[name]))
        with self._telling(slowest, trial):
            times = grid(rows[slowest][TIME_FIELD])
        columns: dict[str, FloatArray] = {}
        faster: dict[str, FloatArray] = {}
        for signal, (stream, channel) in plan.items():
            fresh = rows[stream.name][~_stale(stream, rows[stream.name])]
            if stream.name == slowest and not on_grid(times, fresh[TIME_FIELD]):
                raise Unusable(
                    f"{self.path}: in trial {trial.number}, the times of stream {stream.name!r} "
                    f"are uneven: {_steps(fresh[TIME_FIELD])}; model {self.plan.model} computes "
                    "from one sample to the next and needs even ones",
                    hint="log at a fixed rate, or import what `rigd export --rate` makes of it",
                )
            with self._telling(stream.name, trial):
                if on_grid(times, fresh[TIME_FIELD]):
                    columns[signal] = bridge(times, fresh[TIME_FIELD], fresh[channel])
                else:
                    columns[signal], faster[signal] = self._means(stream, channel, times)
        return (times - times[0]) * 1e-9, columns, faster

    def rows(self, trial: TrialInfo) -> TrialRows:
        """Return every signal of the plan at the rows of the slowest stream, even or not.

        For what is pointwise in time: signals of one stream are rows of one instant, and no row is
        invented. Another stream comes to the rows by the rule of :func:`.resample.brought`. Rows
        that repeat an earlier one, and those at which another stream has a gap, are left out.

        Raises:
            DataError: a stream or channel that the plan names is not in the recording.
            Unusable: no row of this trial has all signals.
        """
        plan = {name: self.field(name) for name in self.plan.signals}
        if not plan:
            raise DataError(f"{self.path}: its plan of identification names no signals")
        streams = {stream.name: stream for stream, _ in plan.values()}
        found = {name: self._fresh(stream, trial) for name, stream in streams.items()}
        base = min(found, key=lambda name: len(found[name]))
        times = found[base][TIME_FIELD]
        signals: dict[str, FloatArray] = {}
        curved: dict[str, FloatArray] = {}
        rules: list[str] = []
        there = np.ones(len(times), np.bool_)
        for signal, (stream, channel) in plan.items():
            if not len(found[stream.name]):
                raise Unusable(
                    f"{self.path}: in trial {trial.number}, all rows of {stream.name} are late"
                )
            if stream.name == base:
                signals[signal] = np.ascontiguousarray(found[base][channel])
                continue
            samples = self._fresh(stream, trial, _margin_ns(found[stream.name][TIME_FIELD], times))
            item = brought(times, samples[TIME_FIELD], np.ascontiguousarray(samples[channel]))
            signals[signal], there = item.values, there & item.there
            if item.curved is not None:
                curved[signal] = item.curved
            if item.rule is not SamplingRule.SAME:
                rates = (1e9 / period_ns(part) for part in (samples[TIME_FIELD], times))
                own, rows = (f"{rate:.4g} Hz" for rate in rates)
                rules.append(
                    f"The {signal}, of {stream.name} at {own}, stands at the rows of {base} at "
                    f"{rows}: {item.rule.value}."
                )
        if not np.any(there):
            raise Unusable(
                f"{self.path}: in trial {trial.number}, {', '.join(sorted(found))} have no sample "
                "at the same time",
                hint="their clocks differ, or one recorded while the other did not: "
                "`rigd report` draws the recording",
            )
        if late := sum(len(self._rows(name, trial)) - len(found[name]) for name in found):
            rules.append(f"{late} rows that repeat an earlier one are left out.")
        if count := int(np.count_nonzero(~there)):
            rules.append(
                f"{count} rows in gaps of another stream are left out (longest step that is "
                f"bridged: {LONGEST_STEP:g} periods)."
            )
        t_s = (times[there] - times[0]) * 1e-9
        kept, bent = (
            {name: values[there] for name, values in found.items()} for found in (signals, curved)
        )
        return TrialRows(t_s, kept, tuple(rules), bent)

    def _fresh(self, stream: Stream, trial: TrialInfo, margin_ns: int = 0) -> NDArray[np.void]:
        """Return the rows of ``stream`` in ``trial``, and so long before and after, less late ones.

        Raises:
            DataError: there is none in the trial.
        """
        if not margin_ns:
            rows = self._rows(stream.name, trial)
        else:
            end_ns = None if trial.end_ns is None else trial.end_ns + margin_ns
            rows = self.recording.read(stream.name, trial.start_ns - margin_ns, end_ns)
        fresh: NDArray[np.void] = rows[~_stale(stream, rows)]
        return fresh

    def _rows(self, stream: str, trial: TrialInfo) -> NDArray[np.void]:
        rows: NDArray[np.void] = self.recording.read(stream, trial.start_ns, trial.end_ns)
        if not len(rows):
            raise DataError(f"{self.path}: stream {stream!r} has no sample in trial {trial.number}")
        return rows

    def bridged(self, trial: TrialInfo) -> int:
        """Return how many rows of the plan's streams are missing or late in ``trial``."""
        count = 0
        for name in {self.field(signal)[0].name for signal in self.plan.signals}:
            rows = self._rows(name, trial)
            late = int(np.count_nonzero(_stale(self.recording.streams[name], rows)))
            count += late + len(grid(rows[TIME_FIELD])) - len(rows)
        return count

    def _means(
        self, stream: Stream, field: str, times: NDArray[np.int64]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the means of a faster stream around ``times``, and the samples of them."""
        around = round(period_ns(times))
        rows = self.recording.read(stream.name, int(times[0]) - around, int(times[-1]) + around)
        fresh = rows[~_stale(stream, rows)]
        values = np.ascontiguousarray(fresh[field])
        return means_around(times, fresh[TIME_FIELD], values), values

    @contextmanager
    def _telling(self, stream: str, trial: TrialInfo) -> Iterator[None]:
        """Add stream and trial to an error."""
        try:
            yield
        except DataError as error:
            raise Unusable(
                f"{self.path}: in trial {trial.number}, stream {stream!r} does not fit the others: "
                f"{error.message}",
                hint="samples are missing or decimated: record all streams of the model whole; "
                "repeat the trial if a device was late",
            ) from error

    def unit(self, signal: str, wanted: str) -> str:
        """Return which of the units ``wanted``, such as ``N or N m``, is that of a signal.

        Raises:
            DataError: the plan does not name the signal, it was not recorded, or it has another.
        """
        stream, name = self.field(signal)
        found = next(item.unit for item in stream.channels if item.name == name)
        for unit in choices(wanted):
            if parse_unit(found).same_kind(parse_unit(unit)):
                return unit
        raise DataError(
            f"{self.path}: the signal {signal} is {stream.name}.{name}, in {found}; model "
            f"{self.plan.model} works from {wanted}"
        )

    def field(self, signal: str) -> tuple[Stream, str]:
        """Return the stream and the channel of it that give a signal of the plan.

        Raises:
            DataError: the plan does not name it, or it was not recorded.
        """
        channel = self.plan.signals.get(signal)
        if channel is None:
            raise DataError(
                f"{self.path}: its plan of identification names no signal {signal!r}",
                hint="give it under `identify: signals:` in the procedure",
            )
        device, _, field = channel.partition(".")
        stream = self.recording.streams.get(device)
        if stream is None:
            raise DataError(
                f"{self.path}: signal {signal!r} needs the stream {device!r}, "
                f"which was not recorded (there are: {', '.join(self.recording.streams)})",
                hint=f"add {device} to `record` in the procedure and run it again",
            )
        if field not in {item.name for item in stream.channels}:
            raise DataError(f"{self.path}: stream {device!r} has no channel {field!r}")
        return stream, field


def _steps(times: NDArray[np.int64]) -> str:
    """Return the steps between ``times`` (n,) in ns as a person reads them."""
    steps = np.diff(times) / 1e6
    return (
        f"steps of {np.min(steps):.4g} to {np.max(steps):.4g} ms, {np.median(steps):.4g} ms usually"
    )


def _margin_ns(*streams: NDArray[np.int64]) -> int:
    """Return the longest usual step of ``streams``, of their times (n,) in ns; 0 without any."""
    periods = [period_ns(times) for times in streams]
    return round(LONGEST_STEP * max((x for x in periods if np.isfinite(x)), default=0.0))


def _stale(stream: Stream, rows: NDArray[np.void]) -> NDArray[np.bool_]:
    """Return which rows repeat an earlier one; none of a stream without a status word."""
    return stale_rows(rows[STATUS_FIELD]) if stream.has_status else np.zeros(len(rows), np.bool_)


def _damaged(recording: Recording) -> str:
    if not recording.problem:
        return ""
    path = quote(str(recording.path))
    return f"; it is damaged ({recording.problem}): see `rigd verify {path}`, `rigd recover {path}`"


def needed_trials(recording: Recording, signals: Mapping[str, str]) -> tuple[TrialInfo, ...]:
    """Return the trials; one that lost rows of a stream with one of ``signals`` is not complete.

    One that was held by a pause is not complete either: the rig did not do what the trial plans.
    """
    needed = {channel.partition(".")[0] for channel in signals.values()}
    events, found = recording.all_events, []
    for trial in recording.trials_for(needed):
        info, why = trial.info, held(events, trial.info)
        if info.complete and why:
            info = replace(info, complete=False, reason=why)
        found.append(info)
    return tuple(found)


def _instead(recording: Recording) -> str:
    """Return what to do with a recording whose procedure identifies nothing."""
    path = quote(str(recording.path))
    attached = recording.attachments.get("procedure.yaml")
    with suppress(ConfigError):  # of another version of rigd
        text = "" if attached is None else attached.data.decode(errors="replace")
        measured = parse_document(text, Path("procedure.yaml")).get(("measure",))
        if isinstance(measured, Mapping) and measured:
            return (
                f"its procedure measures {', '.join(map(str, measured))} without a fit: "
                f"`rigd measure {path}`; to identify, give one with an `identify` block: "
                f"`rigd identify {path} --plan PROCEDURE`"
            )
    return (
        f"give a procedure with an `identify` block: `rigd identify {path} --plan PROCEDURE`; "
        f"`rigd info {path}` shows what the file holds"
    )


def _plan_of(recording: Recording, otherwise: IdentifyPlan | None) -> IdentifyPlan | None:
    """Return the plan that the recording states, ``otherwise`` if it states none.

    Raises:
        DataError: it states one that cannot be read, as another program may, and there is no other.
    """
    stated = recording.metadata.get("identify")
    if stated is None:
        return otherwise
    try:
        known = [item.name for item in fields(IdentifyPlan) if item.name in stated]
        read = {name: _stated(name, stated[name]) for name in known}
        return TypeAdapter(IdentifyPlan).validate_python({"signals": {}, "constants": {}, **read})
    except ValueError as error:
        if otherwise is not None:
            return otherwise
        first = error.errors()[0] if isinstance(error, ValidationError) else None
        why = str(error) if first is None else f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
        raise DataError(
            f"{recording.path}: its metadata `identify` state no plan ({why})",
            hint=_instead(recording),
        ) from error


def _stated(name: str, text: str) -> object:
    """Return what a recording states of its plan under ``name``.

    Raises:
        ValueError: it is no JSON.
    """
    if name in _TEXTS:
        return text
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{name} is no JSON: {error}") from error


def open_sweep(path: Path, otherwise: IdentifyPlan | None = None) -> RecordedSweep:
    """Return the recording at ``path`` with its plan of identification, else with ``otherwise``.

    What is damaged is passed over: ``info.losses`` lists it, and a trial that lost rows of a
    stream with a signal of the plan is not complete.

    Raises:
        RecordingError: the file cannot be read; the message contains what to do.
        DataError: it is no recording of a procedure that identifies anything, what it states of
            that cannot be read, or no trial of it began.
    """
    recording = Recording.open(path, partial=True)
    plan = _plan_of(recording, otherwise)
    if plan is None:
        raise DataError(
            f"{path} does not state what to identify" + _damaged(recording),
            hint=_instead(recording),
        )
    trials = needed_trials(recording, plan.signals)
    sweep = RecordedSweep(recording, replace(recording.info, trials=trials), plan)
    if not sweep.info.trials:
        raise DataError(
            f"{path} has no trial" + _damaged(recording),
            hint=f"`rigd run --resume {quote(str(path))}` plays the missing ones",
        )
    return sweep
