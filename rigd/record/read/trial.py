"""Provides the trials of a recording as objects for notebooks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any, overload

from rigd.model import RecordingError
from rigd.record.events.trials import Step, TrialInfo
from rigd.record.read.tables import Table, stream_table, trials_table

if TYPE_CHECKING:
    import pandas as pd

    from rigd.record.events.event import Event
    from rigd.record.read.reader import Recording


@dataclass(frozen=True, repr=False)
class Trial:
    """One attempt at a trial of a recording: ``trial["carriage"]`` is a table of its samples."""

    recording: Recording
    info: TrialInfo

    @property
    def number(self) -> int:
        """Number in the sweep, from 1; attempts at the same trial share it."""
        return self.info.number

    @property
    def repeat(self) -> int | None:
        """Which repeat of the same parameters it is, from 1."""
        return self.info.repeat

    @property
    def parameters(self) -> Mapping[str, Any]:
        """Values of the swept parameters by name, in SI."""
        return self.info.parameters

    @property
    def units(self) -> Mapping[str, str]:
        """Units in which the procedure gives the parameters, for people."""
        return self.info.units

    @property
    def complete(self) -> bool:
        """Whether all its steps were played and no row of it is lost."""
        return self.info.complete

    @property
    def reason(self) -> str:
        """Why it ended, or which of its data are lost."""
        return self.info.reason

    @property
    def verdict(self) -> str:
        """Whether it is complete, in words; if not, with the reason."""
        return "complete" if self.complete else f"incomplete: {self.reason or 'no end'}"

    @property
    def start_ns(self) -> int:
        """When it began, in ns since the Unix epoch."""
        return self.info.start_ns

    @property
    def end_ns(self) -> int:
        """When it ended, in ns; after the last row if the recording ends within it."""
        return self.recording.end_ns + 1 if self.info.end_ns is None else self.info.end_ns

    @property
    def duration_s(self) -> float:
        """How long it took, in s."""
        return (self.end_ns - self.start_ns) * 1e-9

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """The events from its start to its end, that of its end included."""
        return tuple(
            event
            for event in self.recording.all_events
            if self.start_ns <= event.t_ns <= self.end_ns and event.trial == self.number
        )

    @property
    def steps(self) -> tuple[Step, ...]:
        """The steps that were played, in order."""
        return tuple(
            step
            for step in self.recording.steps
            if step.trial == self.number and self.start_ns <= step.start_ns < self.end_ns
        )

    def __getitem__(self, stream: str) -> Table:
        """Return the samples of a stream within the trial.

        Raises:
            RecordingError: no such stream, or a damaged chunk.

        """
        return stream_table(
            self.recording, stream, (self.info,), self.steps, self.start_ns, self.end_ns
        )

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={value}" for name, value in self.parameters.items())
        shown = f"{values or 'no sweep'}; {self.duration_s:.3g} s, {self.verdict}"
        return f"<trial {self.number}: {shown}>"


class Trials(Sequence[Trial]):
    """All attempts at trials of a recording, in the order they began."""

    def __init__(self, recording: Recording, attempts: Sequence[TrialInfo]) -> None:
        self._recording = recording
        self._attempts = tuple(attempts)

    @overload
    def __getitem__(self, index: int) -> Trial: ...

    @overload
    def __getitem__(self, index: slice) -> Trials: ...

    def __getitem__(self, index: int | slice) -> Trial | Trials:
        """Return the attempt at a position, from 0; :meth:`number` goes by the trial's number."""
        if isinstance(index, slice):
            return Trials(self._recording, self._attempts[index])
        return Trial(self._recording, self._attempts[index])

    def __len__(self) -> int:
        return len(self._attempts)

    def __iter__(self) -> Iterator[Trial]:
        return (Trial(self._recording, attempt) for attempt in self._attempts)

    def of(self, recording: Recording) -> Trials:
        """Return the same trials of ``recording``."""
        return Trials(recording, self._attempts)

    def number(self, number: int) -> Trial:
        """Return the trial of that number: the last attempt that is complete, else the last.

        Raises:
            RecordingError: the recording has no trial of that number.

        """
        attempts = [attempt for attempt in self._attempts if attempt.number == number]
        if not attempts:
            known = sorted({attempt.number for attempt in self._attempts})
            raise RecordingError(
                f"{self._recording.path} has no trial {number}", hint=f"It has {known}."
            )
        complete = [attempt for attempt in attempts if attempt.complete]
        return Trial(self._recording, (complete or attempts)[-1])

    @cached_property
    def table(self) -> Table:
        """The trials as a table (:func:`~rigd.record.read.tables.trials_table`)."""
        return trials_table(self._attempts, self._recording.start_ns)

    def to_pandas(self) -> pd.DataFrame:
        """Return the table as a DataFrame.

        Raises:
            RecordingError: pandas is not installed.

        """
        return self.table.to_pandas()

    def __repr__(self) -> str:
        count = "1 trial" if len(self) == 1 else f"{len(self)} trials"
        return "\n".join([count, *map(repr, self)])

    def _repr_html_(self) -> str:
        table = self.table
        heads = (
            f"{name} [{table.units[name]}]" if table.units.get(name) else name
            for name in table.columns
        )
        rows = zip(*table.columns.values(), strict=True)
        rows = zip(*table.columns.values(), strict=True)
        lines = [_cells("th", heads), *(_cells("td", map(_shown, row)) for row in rows)]
        return f"<table>{''.join(lines)}</table>"


def _cells(tag: str, texts: Iterator[str]) -> str:
    return f"<tr>{''.join(f'<{tag}>{escape(text)}</{tag}>' for text in texts)}</tr>"


def _shown(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
