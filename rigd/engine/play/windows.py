"""Stores the recording windows: the times of the steps during which a stream is recorded.

A block device returns a row some time after the device took it, perhaps in another process. The
time at which the row was taken decides if it is recorded. So the cycle writes the times at which a
window opened and closed, and the process that records compares the time of each row with them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from rigd.engine.play.conditions import Taken, Watches
from rigd.model.errors import DeviceError
from rigd.procedure.program import Recorded

#: Number of windows that are kept; a block device is a few blocks late, and a step is rarely
#: shorter.
_KEPT: Final = 32
#: Words, then opening and closing time of each window.
_DECIDED, _COUNT, _LAG, _PAIRS = 0, 1, 2, 3
_LINE_BYTES: Final = 64
_STILL_OPEN: Final = 2**63 - 1


class Windows:
    """The windows of one stream, written by the cycle and read by the recorder.

    A window has the times from its opening to before its closing, Unix time in ns. Both are in
    ``memory`` of :data:`BYTES` bytes, which processes may share: each word has one writer and is
    written after the data that it announces (see :mod:`rigd.engine.shared.mapping`).
    """

    #: Whole cache lines.
    BYTES: Final = _LINE_BYTES * -(-8 * (_PAIRS + 2 * _KEPT) // _LINE_BYTES)

    def __init__(self, memory: memoryview) -> None:
        self._words = memory.cast("B")[: self.BYTES].cast("q")
        self.is_open = False  #: for the writer: whether rows of this cycle are recorded
        self._next = 0  #: for the reader: the first window that may contain future rows

    @classmethod
    def unshared(cls) -> Self:
        """Return windows for this process only."""
        return cls(memoryview(bytearray(cls.BYTES)))

    def decide(self, t_ns: int, *, is_open: bool) -> None:
        """Decide in the cycle at ``t_ns`` whether rows taken from now on are recorded."""
        words = self._words
        if is_open is not self.is_open:
            self.is_open = is_open
            count = words[_COUNT]
            if is_open:
                place = _PAIRS + 2 * (count % _KEPT)
                words[place], words[place + 1] = t_ns, _STILL_OPEN
                words[_COUNT] = count + 1
            else:
                words[_PAIRS + 2 * ((count - 1) % _KEPT) + 1] = t_ns
        words[_DECIDED] = t_ns

    @property
    def lag_ns(self) -> int:
        """How long after a time the cycle decides about it; 0 for windows of steps."""
        return self._words[_LAG]

    @lag_ns.setter
    def lag_ns(self, lag_ns: int) -> None:
        self._words[_LAG] = lag_ns

    @property
    def decided_ns(self) -> int:
        """The decision on rows taken until this time is final; 0 before the first cycle."""
        return self._words[_DECIDED]

    def covers(self, times_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which of ``times_ns``, increasing from call to call, are in a window.

        Raises:
            DeviceError: so many windows have followed that some are no longer kept.
        """
        inside = np.zeros(len(times_ns), np.bool_)
        words, first = self._words, self._next
        for number in range(first, words[_COUNT]):
            place = _PAIRS + 2 * (number % _KEPT)
            opened, closed = words[place], words[place + 1]
            low, high = np.searchsorted(times_ns, (opened, closed))
            inside[low:high] = True
            if len(times_ns) and closed <= times_ns[-1]:
                self._next = number + 1
        if words[_COUNT] - first >= _KEPT:  # the oldest of them may be overwritten by now
            raise DeviceError(
                f"its rows arrive more than {_KEPT - 1} recording windows late",
                hint="use smaller blocks, or longer steps in `record: ... during`",
            )
        return inside

    def forget(self) -> None:
        """Forget all but the newest windows: no row waits, and those to come are not that late."""
        self._next = max(self._next, self._words[_COUNT] - _KEPT // 2)


@dataclass
class _Captured:
    """The windows of a stream that is recorded around what it waits for."""

    stream: str
    watches: Watches
    before_ns: int
    after_ns: int
    windows: Windows
    met_ns: int | None = None  #: when it was met last


class RecordWindows:
    """Opens and closes the windows of streams that are not recorded at all times.

    ``shared`` has the windows that another process reads, ``readings`` the places of channels,
    ``taken`` the times of their values.

    A capture includes rows that were taken before the cycle knows of it. So about a row of time t
    the cycle decides ``before_s`` later, and the row waits as long: that is all that differs.
    """

    def __init__(
        self,
        record: Mapping[str, Recorded],
        shared: Mapping[str, Windows],
        readings: Mapping[str, int],
        taken: Taken | None = None,
    ) -> None:
        self._of = {
            stream: shared.get(stream) or Windows.unshared()
            for stream, recorded in record.items()
            if recorded.windowed
        }
        self._steps = [
            (record[stream].during, windows)
            for stream, windows in self._of.items()
            if record[stream].during
        ]
        self._captures: list[_Captured] = []
        for stream, windows in self._of.items():
            capture = record[stream].capture
            if capture is not None:
                windows.lag_ns = round(capture.before_s * 1e9)
                watches = Watches(capture.when, readings, taken)
                after_ns = round(capture.after_s * 1e9)
                self._captures.append(_Captured(stream, watches, windows.lag_ns, after_ns, windows))

    def of(self, stream: str) -> Windows | None:
        """Return the windows of ``stream``; None if it is always recorded."""
        return self._of.get(stream)

    def decide(
        self, t_ns: int, step: str, values: Sequence[float]
    ) -> Sequence[Mapping[str, object]]:
        """Decide for all streams in the cycle at ``t_ns``, in which ``step`` plays ("": none).

        Returns what has begun or ended to be captured, for the events of the recording.
        """
        for during, windows in self._steps:
            windows.decide(t_ns, is_open=step in during)
        if not self._captures:
            return ()
        changed = []
        for item in self._captures:
            if item.watches.met(t_ns, values):
                item.met_ns = t_ns
            was_open, met_ns = item.windows.is_open, item.met_ns
            is_open = met_ns is not None and t_ns - met_ns <= item.before_ns + item.after_ns
            item.windows.decide(t_ns - item.before_ns, is_open=is_open)
            if is_open is not was_open:
                changed.append({"stream": item.stream, "recorded": is_open})
        return changed

    def finish(self, t_ns: int) -> None:
        """Decide about all rows until ``t_ns``: no cycle may follow."""
        for _, windows in self._steps:
            windows.decide(t_ns, is_open=False)
        for item in self._captures:
            if item.windows.is_open and item.met_ns is not None:
                item.windows.decide(min(item.met_ns + item.after_ns, t_ns) + 1, is_open=False)
            item.windows.decide(t_ns, is_open=False)
