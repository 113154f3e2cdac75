"""A simulated device served on an event loop of its own, as `rigd sim` does in its process."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from rigd_sim.wire.part import Part

T = TypeVar("T")
#: Calls a function on the loop of the part and returns what it gives.
OnLoop = Callable[[Callable[[], Any]], Any]


@contextmanager
def served(part: Part) -> Iterator[OnLoop]:
    """Serve ``part`` in a thread; yield what runs a function on its loop."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, name=part.name)
    thread.start()

    def run(coroutine: Coroutine[Any, Any, T]) -> T:
        return asyncio.run_coroutine_threadsafe(coroutine, loop).result(timeout=30)

    async def call(function: Callable[[], T]) -> T:
        return function()

    try:
        run(part.start())
        try:
            yield lambda function: run(call(function))
        finally:
            run(part.stop())
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join(timeout=30)
        loop.close()
