"""Defines the simulated device (peer) that a driver is checked against, and its faults."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final, Protocol, TypeVar

T = TypeVar("T")

#: Faults that the suite asks a peer for, by name.
FAULTS: Final[Mapping[str, str]] = {
    "dead": "the connection is gone, as by a pulled plug",
    "silent": "it is connected and sends nothing",
    "late": "it answers, but a second or so too late",
    "garbled": "what it sends is damaged",
}


@dataclass(frozen=True)
class Peer:
    """A running simulated device: the address for the driver, and the ways to make it fail.

    The author of a driver gives the suite a function, used as a context manager, that starts a
    fresh one::

        @contextmanager
        def simulated_acme() -> Iterator[Peer]:
            device = FakeAcme()
            try:
                yield Peer(options={"port": device.port}, faults={"dead": device.unplug})
            finally:
                device.close()
    """

    #: Options that give the driver its address, beside those given to the suite.
    options: Mapping[str, Any] = field(default_factory=dict)
    #: Makes the link of the driver, not opened yet; a plant for a device in process.
    link: Callable[[], Any] = lambda: None
    #: Functions that begin each of :data:`FAULTS`, without those that it cannot show.
    faults: Mapping[str, Callable[[], object]] = field(default_factory=dict)


class RunOnLoop(Protocol):
    """Runs a coroutine on a loop in another thread and returns its result."""

    def __call__(self, coroutine: Coroutine[Any, Any, T], /) -> T:
        """Wait for ``coroutine``."""


@contextmanager
def background_loop() -> Iterator[RunOnLoop]:
    """Run an event loop in a thread, for peers that are servers on asyncio.

    ::

        with background_loop() as run:
            run(server.start())
    """
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, name="peer", daemon=True)
    thread.start()

    def run(coroutine: Coroutine[Any, Any, T], /) -> T:
        return asyncio.run_coroutine_threadsafe(coroutine, loop).result(timeout=30)

    try:
        yield run
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join(timeout=30)
        loop.close()
