"""Tells a driver that blocks the event loop from a machine that stalls."""

from __future__ import annotations

import asyncio
import threading
import time
from typing import Final, Self

#: Time between two ticks of the loop, in s, and of the witness.
TICK_S: Final = 0.005
#: A loop that does not tick for so long stands still, in s.
STUCK_S: Final = 0.03
#: The machine was not at fault if the witness never waited for more than this part of the time.
WITNESS_PART: Final = 0.5


class Stalls:
    """Watches the loop, and a thread beside it: a stall of the machine stops both.

    Used in the loop, as a context manager; ``found`` are the times for which only the loop stood
    still, in s.
    """

    def __init__(self) -> None:
        self.found: list[float] = []
        self._ended = threading.Event()
        self._ticks: list[float] = []
        self._witness = threading.Thread(target=self._watch, name="witness", daemon=True)

    def __enter__(self) -> Self:
        self._witness.start()
        self._ticking = asyncio.create_task(self._tick())
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._witness.join()
        self._ticking.cancel()

    async def stop(self) -> None:
        """End the ticks of the loop."""
        self._ticking.cancel()
        await asyncio.wait({self._ticking})

    def _watch(self) -> None:
        while not self._ended.wait(TICK_S):
            self._ticks.append(time.monotonic())

    async def _tick(self) -> None:
        while True:
            before = time.monotonic()
            await asyncio.sleep(TICK_S)
            now = time.monotonic()
            if now - before > STUCK_S and self._went_on(before, now):
                self.found.append(now - before)

    def _went_on(self, before: float, now: float) -> bool:
        """Return whether the witness ticked meanwhile."""
        ticks = [tick for tick in list(self._ticks) if before <= tick <= now]
        gaps = [b - a for a, b in zip([before, *ticks], [*ticks, now], strict=True)]
        return max(gaps) <= WITNESS_PART * (now - before)
