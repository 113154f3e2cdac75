"""Recording windows: the steps during which a stream is recorded.

A block device hands rows over some time after they were taken, perhaps in a process of its own.
What counts is when a row was taken: the cycle writes down when a window opened and closed, and who
records looks up each row's time there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from rigd.model.errors import DeviceError
from rigd.procedure.program import Recorded

#: Windows that are remembered; a block device is a few blocks behind, and a step rarely shorter.
_KEPT: Final = 32
_DECIDED, _COUNT, _PAIRS = 0, 1, 2  #: words, then opening and closing time of each window
_LINE_BYTES: Final = 64
_STILL_OPEN: Final = 2**63 - 1


class Windows:
    """The windows of one stream, written by the cycle and read by one who records.

    A window holds the times from its opening to before its closing, Unix time in ns. Both stand in
    ``memory`` of :data:`BYTES`, which processes may share: each word has one writer and is written
    behind what it announces (see :mod:`rigd.engine.shared.mapping`).
    """

    #: Whole cache lines.
    BYTES: Final = _LINE_BYTES * -(-8 * (_PAIRS + 2 * _KEPT) // _LINE_BYTES)

    def __init__(self, memory: memoryview) -> None:
        self._words = memory.cast("B")[: self.BYTES].cast("q")
        self.is_open = False  #: for the writer: whether a row of this cycle is recorded
        self._next = 0  #: for the reader: the first window that rows to come may lie in

    @classmethod
    def unshared(cls) -> Self:
        """Return windows that stay within this process."""
        return cls(memoryview(bytearray(cls.BYTES)))

    def decide(self, t_ns: int, *, is_open: bool) -> None:
        """Let the cycle at ``t_ns`` say whether what is taken from now on is recorded."""
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
    def decided_ns(self) -> int:
        """All is said about rows taken until this time; 0 before the first cycle."""
        return self._words[_DECIDED]

    def covers(self, times_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which of ``times_ns``, increasing from call to call, lie in a window.

        Raises:
            DeviceError: so many windows have come since that some are forgotten.
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
        if words[_COUNT] - first >= _KEPT:  # the oldest one looked at may be overwritten by now
            raise DeviceError(
                f"its rows come more than {_KEPT - 1} recording windows late",
                hint="smaller blocks, or longer steps in `record: ... during`",
            )
        return inside


class StepWindows:
    """Opens and closes the windows of the streams that are recorded during some steps only.

    ``shared`` holds those that another process reads.
    """

    def __init__(self, record: Mapping[str, Recorded], shared: Mapping[str, Windows]) -> None:
        self._of = {
            stream: shared.get(stream) or Windows.unshared()
            for stream, recorded in record.items()
            if recorded.during
        }
        self._all = [(record[stream].during, windows) for stream, windows in self._of.items()]

    def of(self, stream: str) -> Windows | None:
        """Return the windows of ``stream``; None where it is recorded always."""
        return self._of.get(stream)

    def decide(self, t_ns: int, step: str) -> None:
        """Let the cycle at ``t_ns``, in which ``step`` plays ("": none), decide for all streams."""
        for during, windows in self._all:
            windows.decide(t_ns, is_open=step in during)
