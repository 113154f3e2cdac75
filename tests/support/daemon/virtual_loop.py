"""An event loop whose clock goes on only when nothing is left to do: waits take no time."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


class VirtualLoop(asyncio.SelectorEventLoop):
    """Begins at 0 s; ``now`` may be set later, as on a computer that was kept from working."""

    now = 0.0

    def time(self) -> float:
        """Return the virtual time, s."""
        return self.now

    def _run_once(self) -> None:
        due = [item.when() for item in self._scheduled if not item.cancelled()]  # type: ignore[attr-defined]
        if due and not self._ready:  # type: ignore[attr-defined]
            self.now = max(self.now, min(due))
        super()._run_once()  # type: ignore[misc]


def in_virtual_time(coroutine: Coroutine[Any, Any, T]) -> T:
    """Return the result of ``coroutine`` on such a loop."""
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(coroutine)
