"""Defines the interface to which a run writes rows and events: a recording or a dry run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

Rows = np.ndarray[tuple[int], np.dtype[np.void]]


class Sink(Protocol):
    """Takes the rows and events of a run; :class:`rigd.record.RecordingWriter` is one."""

    def write(self, stream: str, rows: Rows) -> None:
        """Append rows of one stream, laid out as :func:`rigd.model.rows.row_dtype`, shape (n,)."""
        ...

    def event(self, t_ns: int, kind: str, trial: int, data: Mapping[str, object]) -> None:
        """Append an event; ``trial`` is its number, or NO_TRIAL."""
        ...

    def flush(self, *, complete: bool = False) -> None:
        """Write everything so far to a place that survives a crash; ``complete``: to be read."""
        ...

    def close(self) -> None:
        """Complete the data; closing twice is silent."""
        ...
