"""A served LabJack on terminals that a test turns and reads, and the link to it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from support.cards.ni_card import Block
from support.cards.served import OnLoop, served

from rigd_drivers.cards.labjack.config import LabjackConfig
from rigd_drivers.cards.labjack.link import Labjack
from rigd_sim.wire.cards.labjack import CONNECTIONS, SimLabjack
from rigd_sim.wire.cards.labjack_registers import LabjackRegisters
from rigd_sim.wire.modbus.line import TcpLine

#: Lines 8 to 15 are the outputs 0 to 7 of the block, 16 to 22 its inputs 0 to 6; of these 15 and
#: 19 are wired to one another.
OPTIONS = {
    "analog_outputs": ["TDAC4", "TDAC5", "DAC0"], "outputs": [8, 9, 10, 15],
    "inputs": [16, 17, 19], "edge_counters": [6, 7],
    "watchdog": {"output": 15, "input": 19, "timeout": "1 s"},
}  # fmt: skip


def registers_of(block: Block, clock_s: Callable[[], float] = time.monotonic) -> LabjackRegisters:
    """Return a T7 on ``block``; 0 and 2 are encoders, 6 and 7 count edges."""
    return LabjackRegisters(
        block.wires(),
        lines_out={line: line - 8 for line in range(8, 16)},
        lines_in={16: 0, 17: 1, 18: 2, 19: 7},
        volts_out={"TDAC4": 0, "TDAC5": 1, "DAC0": 2, "DAC1": 3, "TDAC6": 0},
        counters={0: 0, 2: 1, 6: 2, 7: 3},
        clock_s=clock_s,
    )


@dataclass
class Clock:
    """A clock of the device that a test sets forward."""

    ahead_s: float = 0.0

    def __call__(self) -> float:
        """Return the time, in s."""
        return time.monotonic() + self.ahead_s


@dataclass
class ServedLabjack:
    """The device, its server, and how links to it are made."""

    block: Block
    part: SimLabjack
    line: TcpLine
    clock: Clock
    on_loop: OnLoop

    @property
    def port(self) -> int:
        """The TCP port that it is served on."""
        return self.line.port

    def config(self, **options: Any) -> LabjackConfig:
        """Return the options of a link; ``options`` as in a rig file."""
        given = {"host": "127.0.0.1", "port": self.port, **OPTIONS, **options}
        return LabjackConfig.model_validate(given)

    def link(self, **options: Any) -> Labjack:
        """Return a link that is not open; ``options`` as in a rig file."""
        return Labjack(self.config(**options))

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault of the device."""
        self.on_loop(lambda: self.part.inject(fault, **options))

    def clear(self, fault: str | None = None) -> None:
        """Show it no more."""
        self.on_loop(lambda: self.part.clear(fault))

    def drop(self) -> None:
        """Reset its connections; it takes others."""
        self.on_loop(self.line.drop)

    def state(self) -> Mapping[str, Any]:
        """Return what an observer sees."""
        return dict(self.on_loop(self.part.state))

    def pass_time(self, seconds: float) -> None:
        """Let the device see so much time go by at once."""
        self.clock.ahead_s += seconds
        self.state()


@contextmanager
def labjack() -> Iterator[ServedLabjack]:
    """Serve a device."""
    block, clock = Block(), Clock()
    line = TcpLine("127.0.0.1", 0, CONNECTIONS)
    part = SimLabjack("labjack", line, registers_of(block, clock), block)
    with served(part) as on_loop:
        yield ServedLabjack(block, part, line, clock, on_loop)


def cycle(link: Labjack) -> None:
    """Let a cycle without devices go by."""
    link.begin(0)
    link.end(0)
