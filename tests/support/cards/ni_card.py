"""A served NI card on terminals that a test turns and reads, and the link to it."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from support.cards.served import OnLoop, served

from rigd_drivers.cards.ni_io.config import NiIoConfig
from rigd_drivers.cards.ni_io.link import NiIo
from rigd_sim.wire.cards.mf624_registers import Wires
from rigd_sim.wire.cards.ni_io import SimNiIo
from rigd_sim.wire.cards.ni_terminals import Terminals
from rigd_sim.wire.part import State

#: Longer than this machine stalls at most times.
WATCHDOG_S = 0.4
WATCHDOG = {"output": 7, "input": 7, "time": f"{WATCHDOG_S} s"}


@dataclass
class Block:
    """The terminal block of a card: digital output 7 is wired to digital input 7."""

    volts_in: list[float] = field(default_factory=lambda: [0.0] * 8)
    volts_out: list[float] = field(default_factory=lambda: [0.0] * 4)
    counts: list[int] = field(default_factory=lambda: [0] * 4)
    duty: float = 0.5  #: of all counters
    clock_ns: int | None = None  #: None: that of this machine
    lines_in: int = 0
    lines_out: int = 0
    cut: bool = False  #: the wire from output 7 to input 7
    faults: Mapping[str, str] = field(default_factory=dict)

    def wires(self) -> Wires:
        """Return these as the card's."""

        def put(lines: int) -> None:
            self.lines_out = lines

        def level() -> int:
            return self.lines_in | (0 if self.cut else self.lines_out & 0x80)

        return Wires(
            volts_in={item: partial(self.volts_in.__getitem__, item) for item in range(8)},
            volts_out={item: partial(self.volts_out.__setitem__, item) for item in range(4)},
            counts_in={item: partial(self.counts.__getitem__, item) for item in range(4)},
            duty_in={item: lambda: self.duty for item in range(4)},
            lines_in=level,
            lines_out=put,
        )

    def now_ns(self) -> int:
        """Return the time of the card."""
        return time.monotonic_ns() if self.clock_ns is None else self.clock_ns

    def state(self) -> State:
        """Nothing but the card's own."""
        return {}

    def inject(self, fault: str, **options: Any) -> None:
        """Nothing can fail here."""

    def clear(self, fault: str | None = None) -> None:
        """Nothing has failed."""


@dataclass
class ServedCard:
    """The card, its server, and how links to it are made."""

    block: Block
    part: SimNiIo
    on_loop: OnLoop

    def link(self, **options: Any) -> NiIo:
        """Return a link that is not open; ``options`` as in a rig file."""
        given = {
            "server": f"127.0.0.1:{self.part.port}", "input_lines": "port0/line8:15",
            "watchdog": WATCHDOG, **options,
        }  # fmt: skip
        return NiIo(NiIoConfig.model_validate(given))

    def pulse(self, counter: int, pulses: int, seconds: float) -> None:
        """Let so many pulses come at a counter, spread over so long on the card's own clock."""

        def come() -> None:
            self.block.clock_ns = (self.block.clock_ns or 0) + round(seconds * 1e9)
            self.block.counts[counter] += pulses
            self.part.state()  # the card looks at its wires

        self.on_loop(come)

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault of the card."""
        self.on_loop(lambda: self.part.inject(fault, **options))

    def clear(self, fault: str | None = None) -> None:
        """Show it no more."""
        self.on_loop(lambda: self.part.clear(fault))

    def state(self) -> Mapping[str, Any]:
        """Return what an observer sees."""
        return dict(self.on_loop(self.part.state))


@contextmanager
def ni_card(*, guards_volts: bool = True, clock_ns: int | None = None) -> Iterator[ServedCard]:
    """Serve a card; ``clock_ns`` begins a clock that stands but for :meth:`ServedCard.pulse`."""
    block = Block(clock_ns=clock_ns)
    lines = [f"port0/line{number}" for number in range(16)]
    terminals = Terminals(
        block.wires(), lines[:8], lines[8:], guards_volts=guards_volts, clock_ns=block.now_ns
    )
    part = SimNiIo("card", terminals, block)
    with served(part) as on_loop:
        yield ServedCard(block, part, on_loop)


def cycle(link: NiIo) -> None:
    """Let a cycle without devices go by."""
    link.begin(0)
    link.end(0)


def wait_until_expired(card: ServedCard) -> None:
    """Return once the watchdog of the card has expired."""
    deadline = time.monotonic() + 30.0
    while not card.state()["watchdog_expired"]:
        assert time.monotonic() < deadline
        time.sleep(0.01)
