"""The interface to which rows and events are written: a recording or a dry run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

Rows = np.ndarray[tuple[int], np.dtype[np.void]]


class Sink(Protocol):
    """Takes what a run produces; :class:`rigd.record.RecordingWriter` is one."""

    def write(self, stream: str, rows: Rows) -> None:
        """Take rows of one stream, laid out as :func:`rigd.model.rows.row_dtype`, shape (n,)."""
        ...

    def event(self, t_ns: int, kind: str, trial: int, data: Mapping[str, object]) -> None:
        """Take one event; ``trial`` is its number, or NO_TRIAL."""
        ...

    def flush(self) -> None:
        """Put everything taken so far where a crash cannot reach it."""
        ...

    def close(self) -> None:
        """Finish; closing twice is silent."""
        ...
