"""Cards for tests: one on registers of the test's own, and one served at a socket."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial

from rigd_drivers.cards.mf624.access import RegIO
from rigd_drivers.cards.mf624.link import Mf624, Mf624Config
from rigd_sim.wire.cards.analog_drives import OneShot
from rigd_sim.wire.cards.mf624_registers import Mf624Registers, Wires
from rigd_sim.wire.part import Part


class BenchMf624(Mf624):
    """An MF624 whose registers the test has made."""

    def __init__(self, io: RegIO, **options: object) -> None:
        super().__init__(Mf624Config.model_validate(options))
        self.io = io
        self.alone: list[bool] = []

    def connect(self, *, alone: bool) -> RegIO:
        self.alone.append(alone)
        return self.io

    def cycle(self) -> None:
        """Let a cycle without devices go by."""
        self.begin(0)
        self.end(0)


@dataclass
class Terminals:
    """The terminal block of a simulated card, as a test turns and reads it."""

    volts_in: list[float] = field(default_factory=lambda: [0.0] * 8)
    volts_out: list[float] = field(default_factory=lambda: [0.0] * 8)
    counts: list[int] = field(default_factory=lambda: [0] * 4)
    index: list[bool] = field(default_factory=lambda: [False] * 4)
    lines_in: int = 0
    lines_out: int = 0
    one_shot: OneShot | None = None  #: triggered by digital output 7, seen at digital input 7

    def card(self) -> Mf624Registers:
        """Return a card with everything wired to these terminals."""

        def put_lines(lines: int) -> None:
            self.lines_out = lines
            if self.one_shot is not None:
                self.one_shot.trigger(level=bool(lines >> 7 & 1))

        def lines_in() -> int:
            up = self.one_shot is not None and self.one_shot.up
            return self.lines_in | up << 7

        return Mf624Registers(
            Wires(
                volts_in={item: partial(self.volts_in.__getitem__, item) for item in range(8)},
                volts_out={item: partial(self.volts_out.__setitem__, item) for item in range(8)},
                counts_in={item: partial(self.counts.__getitem__, item) for item in range(4)},
                index_in={item: partial(self.index.__getitem__, item) for item in range(4)},
                lines_in=lines_in,
                lines_out=put_lines,
            )
        )


@contextmanager
def serving(part: Part) -> Iterator[asyncio.AbstractEventLoop]:
    """Serve ``part`` on an event loop in a thread of its own; yields the loop."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    try:
        asyncio.run_coroutine_threadsafe(part.start(), loop).result(10)
        yield loop
    finally:
        asyncio.run_coroutine_threadsafe(part.stop(), loop).result(10)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(10)
        loop.close()
