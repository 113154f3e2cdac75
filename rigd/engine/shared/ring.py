"""Defines what every ring in shared memory has: how far its writer and its reader are."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from rigd.engine.shared.mapping import FIRST_FREE_WORD, SharedFile

CAPACITY: Final = FIRST_FREE_WORD
# The writer's words and the reader's on cache lines of their own (64 bytes).
HEAD: Final = 8  #: pushed since the beginning
OVERRUNS: Final = 9
CLAIM: Final = 10  #: up to which the writer may write, announced or not; before it does
TAIL: Final = 16  #: released since the beginning


class Ring:
    """Counts what was pushed and released, in the unit of its capacity: rows or bytes."""

    def __init__(self, file: SharedFile) -> None:
        self.path: Path = file.path
        self.capacity: int = file.words[CAPACITY]
        self._words = file.words
        self._payload = file.payload

    @property
    def head(self) -> int:
        """How much was pushed since the beginning."""
        return self._words[HEAD]

    @property
    def tail(self) -> int:
        """How much was released since the beginning."""
        return self._words[TAIL]

    @property
    def overruns(self) -> int:
        """How many rows or events were lost because the ring was full."""
        return self._words[OVERRUNS]

    @property
    def fill(self) -> float:
        """Share of the ring that waits to be released, 0 to 1."""
        tail = self.tail  # first: for a third process, the tail may overtake an older head
        return (self.head - tail) / self.capacity
