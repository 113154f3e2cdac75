"""Decides which line answers which question, for a device that answers in lines; without I/O.

Replies have no number. If an answer does not come in time, the next question waits for it. The
first answer after that may still be the one that was given up, so it is not used: it shows how
late answers may be, and for so long nothing is asked. If nothing comes meanwhile, the answer had
been lost.
"""

from __future__ import annotations

from collections import deque
from enum import Enum
from typing import Final

#: How long an answer that did not come is waited for before the next question, in s.
LATE_S: Final = 0.7

#: Questions without answer that are remembered; the driver gives the device up long before.
_MOST_OWED: Final = 64


class Heard(Enum):
    """What a line is that has come."""

    ANSWER = "the answer to the question"
    DOUBTFUL = "an answer that may belong to an earlier question: ask again"
    LATE = "the answer to a question that was given up"
    UNASKED = "a line without a question"


class Questions:
    """Follows one question at a time; all times are of one clock, in s.

    Args:
        late_s: how long an answer that was given up is waited for.

    """

    def __init__(self, late_s: float = LATE_S) -> None:
        self._late_s = late_s
        self._asked_s: float | None = None  # when the question that is open was asked
        self._until_s = 0.0  # when its answer is given up; then, when the next may be asked
        self._owed: deque[float] = deque(maxlen=_MOST_OWED)  # when those without answer were asked
        self._settling = False  # no answer is owed, if none comes before the next question
        #: Answers that came after they were given up.
        self.late = 0

    @property
    def is_open(self) -> bool:
        """Whether a question waits for its answer."""
        return self._asked_s is not None

    @property
    def is_doubtful(self) -> bool:
        """Whether the next answer will be doubtful, so that its question is asked twice."""
        return bool(self._owed) and not self._settling

    def left(self, now_s: float) -> float:
        """Return how long to wait before the next question, in s; 0 if it may be asked."""
        return 0.0 if self.is_open else max(0.0, self._until_s - now_s)

    def asked(self, now_s: float, timeout_s: float) -> None:
        """Note that a question was sent now; its answer is given up after ``timeout_s``."""
        if self._settling:
            self._owed.clear()
            self._settling = False
        self._asked_s = now_s
        self._until_s = now_s + timeout_s

    def expired(self, now_s: float) -> bool:
        """Return whether the open question has had no answer in its time."""
        return self.is_open and now_s >= self._until_s

    def give_up(self, now_s: float, *, owed: bool) -> None:
        """Close the open question without its answer.

        ``owed``: nothing came that could have been its answer, so that it may still come.
        """
        if self._asked_s is None:
            return
        if owed:
            self._owed.append(self._asked_s)
        self._asked_s = None
        self._until_s = now_s + self._late_s if owed else now_s

    def answered(self, now_s: float) -> Heard:
        """Note a line that reads as an answer, and return what it is."""
        if self._asked_s is None:
            return self.passed(now_s)
        asked_s, self._asked_s = self._asked_s, None
        if not self._owed:
            self._until_s = now_s
            return Heard.ANSWER
        self._owed.append(asked_s)
        self._until_s = now_s + (now_s - self._owed.popleft())
        self._settling = True
        return Heard.DOUBTFUL

    def passed(self, now_s: float) -> Heard:
        """Note a line that came without an open question, and return what it is."""
        if not self._owed:
            return Heard.UNASKED
        self.late += 1
        if self._settling:  # answers are late indeed: all that are owed may come
            self._settling = False
        else:
            self._owed.popleft()
            self._until_s = now_s
        return Heard.LATE
