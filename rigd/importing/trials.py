"""Finds the trials in the samples of one source: by columns, by gaps or by a signal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from rigd.importing.map.map import TrialsMap
from rigd.importing.tables.table import SourceTable
from rigd.model.errors import ConfigError

#: A column that changes more often shows no trials.
MOST_SPANS: Final = 100_000


@dataclass
class TrialSpan:
    """Samples one after the other that belong together.

    ``key`` are the texts of the columns that show trials, ``texts`` those of the parameters, at
    the first ``row``. ``inside`` is whether they are a trial, ``open`` whether it may have begun
    before the file or have gone on after it.
    """

    first_ns: int
    last_ns: int
    row: int
    inside: bool
    key: tuple[str, ...] = ()
    texts: Mapping[str, str] = field(default_factory=dict)
    open: bool = False


@dataclass
class TrialFinder:
    """Finds the trials of one table; ``columns`` and ``parameters`` are positions in it."""

    table: SourceTable
    trials: TrialsMap
    columns: Sequence[int]
    parameters: Mapping[str, int]
    steps_column: int | None
    spans: list[TrialSpan] = field(default_factory=list)
    steps: list[tuple[int, str]] = field(default_factory=list)  #: times in ns, and names
    _last_ns: int = 0
    _last_texts: dict[int, Any] = field(default_factory=dict)

    @property
    def wanted(self) -> set[int]:
        """The columns whose texts it reads."""
        steps = () if self.steps_column is None else (self.steps_column,)
        return {*self.columns, *self.parameters.values(), *steps}

    def feed(
        self,
        times: NDArray[np.int64],
        rows: NDArray[np.int64],
        values: NDArray[np.float64] | None,
        texts: Mapping[int, Any],
    ) -> None:
        """Take the next samples: times in ns, numbers of their rows, the signal, texts.

        Raises:
            ConfigError: a parameter changes within a trial, or there are too many trials.
        """
        if not len(times):
            return
        changes = {column: self._changed(column, texts[column]) for column in self.wanted}
        begins = np.zeros(len(times), np.bool_)
        begins[0] = not self.spans
        for column in self.columns:
            begins |= changes[column]
        if self.trials.gap_ns is not None:
            last = self._last_ns if self.spans else int(times[0])
            begins |= np.diff(times, prepend=last) >= self.trials.gap_ns
        inside = np.ones(len(times), np.bool_)
        signal = self.trials.signal
        if signal is not None and values is not None:
            low = -math.inf if signal.above is None else signal.above.value
            high = math.inf if signal.below is None else signal.below.value
            inside = (values > low) & (values < high)
            before = self.spans[-1].inside if self.spans else bool(inside[0])
            begins |= np.diff(inside, prepend=before)
        if self.columns:
            names = pc.utf8_trim_whitespace(texts[self.columns[0]])
            outside = pc.is_in(names, pa.array(sorted(self.trials.outside), pa.string()))
            inside &= ~outside.to_numpy(zero_copy_only=False)
        starts = np.flatnonzero(begins)
        if len(self.spans) + len(starts) > MOST_SPANS:
            raise ConfigError(
                f"there are more than {MOST_SPANS} trials",
                place=self._place(int(rows[starts[-1]])),
                hint="what shows the trials changes too often",
            )  # fmt: skip
        self._check_parameters(changes, inside & ~begins, rows)
        ends = [*starts[1:], len(times)]
        if self.spans:
            upto = starts[0] if len(starts) else len(times)
            if upto:
                self.spans[-1].last_ns = int(times[upto - 1])
        for start, end in zip(starts, ends, strict=bool(len(starts))):
            key = tuple(str(texts[column][start]) for column in self.columns)
            self.spans.append(
                TrialSpan(
                    int(times[start]), int(times[end - 1]), int(rows[start]),
                    bool(inside[start]), key,
                    {name: str(texts[at][start]) for name, at in self.parameters.items()},
                    signal is not None and len(self.spans) == 0,
                )
            )  # fmt: skip
        if self.steps_column is not None:
            found = texts[self.steps_column]
            changed = changes[self.steps_column]
            changed[0] |= not self.steps
            self.steps += [(int(times[at]), str(found[at])) for at in np.flatnonzero(changed)]
        self._last_ns = int(times[-1])
        self._last_texts = {column: texts[column][-1] for column in self.wanted}

    def found(self) -> list[TrialSpan]:
        """Return the trials, without those that are too short."""
        if self.spans and self.trials.signal is not None:
            self.spans[-1].open = True
        return [
            span
            for span in self.spans
            if span.inside and span.last_ns - span.first_ns >= self.trials.shortest_ns
        ]

    def _changed(self, column: int, texts: Any) -> NDArray[np.bool_]:
        """Return at which rows the text of a column differs from the row before."""
        changed = np.zeros(len(texts), np.bool_)
        if len(texts) > 1:
            differs = pc.not_equal(texts[1:], texts[:-1])
            changed[1:] = differs.to_numpy(zero_copy_only=False)
        if column in self._last_texts:
            changed[0] = texts[0] != self._last_texts[column]
        return changed

    def _check_parameters(
        self,
        changes: Mapping[int, NDArray[np.bool_]],
        within: NDArray[np.bool_],
        rows: NDArray[np.int64],
    ) -> None:
        """Refuse a parameter that changes at one of the rows ``within`` a trial."""
        for name, column in self.parameters.items():
            for at in np.flatnonzero(changes[column] & within)[:1]:
                raise ConfigError(
                    f"the parameter {name} changes within a trial",
                    place=self.table.place(column, int(rows[at])),
                    hint="add its column to `columns:` below `trials:` if a new trial begins there",
                )

    def _place(self, row: int) -> Any:
        return self.table.place(self.columns[0] if self.columns else 0, row)
