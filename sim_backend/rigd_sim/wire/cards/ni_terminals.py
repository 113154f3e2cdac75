"""Simulates the terminals of a multifunction NI card and its watchdog timer; no gRPC.

The card is like an NI PCIe-6363 of the X Series (NI 6363 Specifications): 16 bits, ±10 V, 32
inputs, 4 outputs, 4 counters of 32 bits, ports of 32, 8 and 8 lines. It has a watchdog timer
(NI-DAQmx Help, "Watchdog Timers"): a timer that has expired brings lines and outputs to the states
that its task names, and the card takes nothing else for these until the expiration is cleared.
Whether a card guards analogue outputs, too, depends on the card: this one does if
``guards_volts``.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any, ClassVar, Final

from rigd_sim.wire.cards.mf624_registers import Wires
from rigd_sim.wire.cards.ni_card import DaqFault
from rigd_sim.wire.cards.ni_pulses import PulseSource, PulseTimer

RANGE_V: Final = 10.0
INPUTS: Final = 32
OUTPUTS: Final = 4
COUNTERS: Final = 4
LINES: Final = tuple(
    f"port{port}/line{line}" for port, count in enumerate((32, 8, 8)) for line in range(count)
)
_STEP_V: Final = 2 * RANGE_V / 2**16
#: The mains that an open input picks up: V, Hz.
_PICKUP_V: Final = 3.0
_MAINS_HZ: Final = 50.0
_WRITE_EXPIRED: Final = -200678


class Timer:
    """The watchdog timer of the card.

    Args:
        clock_ns: CLOCK_MONOTONIC.
    """

    def __init__(self, clock_ns: Callable[[], int]) -> None:
        self._clock_ns = clock_ns
        self.volts: dict[int, float] = {}  #: analogue output -> V once expired
        self.levels: dict[str, bool] = {}  #: line -> level once expired
        self.dead = False  #: never expires
        self.expired = False
        self._time_ns: int | None = None  # None: not running
        self._reset_ns = 0

    @property
    def running(self) -> bool:
        """Whether it was started."""
        return self._time_ns is not None

    def start(self, time_s: float) -> None:
        """Run from now on."""
        self._time_ns, self._reset_ns = round(time_s * 1e9), self._clock_ns()

    def stop(self) -> None:
        """Run no more; an expiration stays."""
        self._time_ns = None

    def reset(self) -> None:
        """Begin the time again."""
        self._reset_ns = self._clock_ns()

    def has_just_expired(self) -> bool:
        """Look whether the time is over; return True once."""
        time_ns = self._time_ns
        if self.expired or self.dead or time_ns is None:
            return False
        self.expired = self._clock_ns() - self._reset_ns >= time_ns
        return self.expired


class Terminals:
    """What stands at the terminals of the card.

    Args:
        wires: what they are wired to; lines by number, as the card's user counts them.
        outputs: names of the lines that are ``wires.lines_out``, by bit.
        inputs: names of the lines that are ``wires.lines_in``, by bit.
        guards_volts: whether the watchdog can act on analogue outputs.
        clock_ns: CLOCK_MONOTONIC.
    """

    faults: ClassVar[Mapping[str, str]] = {
        "removal": "the card is gone, and its outputs have no power",
        "reset": "another program resets the card: its tasks are gone, its outputs are at 0",
        "watchdog_dead": "the watchdog timer never expires",
        "watchdog_expired": "the watchdog timer expires, now",
        "saturation": "an analogue input stands at a rail (input, rail=high|low)",
        "stuck_code": "an analogue input always gives the code it gave last (input)",
        "open_input": "an analogue input is open and picks up mains (input)",
        "counter_reset": "a counter starts from zero again, once (counter)",
        "sign_flip": "a counter counts the wrong way from now on (counter)",
    }

    def __init__(
        self,
        wires: Wires,
        outputs: Iterable[str],
        inputs: Iterable[str],
        *,
        guards_volts: bool = True,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._wires = wires
        self._bits_out = {line: bit for bit, line in enumerate(outputs)}
        self._bits_in = {line: bit for bit, line in enumerate(inputs)}
        self.guards_volts = guards_volts
        self._clock_ns = clock_ns
        self.timer = Timer(clock_ns)
        self.volts = [0.0] * OUTPUTS
        self._driven: dict[str, bool] = {}
        self._offsets = [0] * COUNTERS
        self._turns = [1] * COUNTERS
        self._last_v = [0.0] * INPUTS
        self._active: dict[str, dict[str, Any]] = {}

    @property
    def removed(self) -> bool:
        """Whether the card is gone."""
        return "removal" in self._active

    @property
    def lines(self) -> int:
        """The digital outputs, one bit each."""
        return sum(1 << bit for line, bit in self._bits_out.items() if self._driven.get(line))

    def advance(self) -> None:
        """Bring the card and what is wired to it to now."""
        self._wires.advance()
        if self.timer.has_just_expired() and not self.removed:
            self._act()

    def volts_at(self, channel: int) -> float:
        """Return what an analogue input converts now, in V."""
        if self._hits("stuck_code", "input", channel):
            return self._last_v[channel]
        if self._hits("saturation", "input", channel):
            volts = math.copysign(99.0, 1 if self._active["saturation"]["rail"] == "high" else -1)
        elif self._hits("open_input", "input", channel):
            volts = _PICKUP_V * math.sin(2e-9 * math.pi * _MAINS_HZ * self._clock_ns())
        else:
            volts = self._wires.volts_in.get(channel, float)()
        code = min(max(round(volts / _STEP_V), -(2**15)), 2**15 - 1)
        self._last_v[channel] = code * _STEP_V
        return self._last_v[channel]

    def counted(self, counter: int) -> int:
        """Return what the wires of a counter have counted, since the card got its power."""
        made = self._wires.counts_in.get(counter, int)()
        return self._turns[counter] * made + self._offsets[counter]

    def timed(self, counter: int, buffer: int) -> PulseTimer:
        """Return what times the pulses at a counter from now on."""
        made = self._wires.counts_in.get(counter, int)
        duty = self._wires.duty_in.get(counter, lambda: 0.5)
        return PulseTimer(PulseSource(made, duty), buffer, self._clock_ns)

    def set_volts(self, first: int, volts: Iterable[float]) -> None:
        """Give these volts from output ``first`` on.

        Raises:
            DaqFault: the watchdog has expired, and holds them.
        """
        for output, value in enumerate(volts, start=first):
            if self.timer.expired and output in self.timer.volts:
                raise _expired()
            self._give(output, value)

    def set_lines(self, levels: Mapping[str, bool]) -> None:
        """Drive these lines; see :meth:`set_volts`."""
        if self.timer.expired and levels.keys() & self.timer.levels.keys():
            raise _expired()
        self._drive(levels)

    def level(self, line: str) -> bool:
        """Return whether a line is high."""
        if line in self._driven:
            return self._driven[line]
        bit = self._bits_in.get(line)
        return bit is not None and bool(self._wires.lines_in() >> bit & 1)

    def lose_power(self) -> None:
        """Let all outputs be at 0, and stop the watchdog."""
        self.timer.stop()
        self.timer.expired = False
        for output in range(OUTPUTS):
            self._give(output, 0.0)
        self._drive(dict.fromkeys(self._driven, False))

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault from now on; the options stand in :attr:`faults`.

        Raises:
            ValueError: there is no such fault, or not with these options.
        """
        checked = _checked(fault, options)
        if fault in ("removal", "reset"):
            self.lose_power()
        match fault:
            case "reset":
                return
            case "watchdog_dead":
                self.timer.dead = True
            case "watchdog_expired":
                self.timer.expired = True
                self._act()
                return
            case "counter_reset":
                counter = checked["counter"]
                self._offsets[counter] -= self.counted(counter)
                return
            case "sign_flip":
                counter = checked["counter"]
                self._offsets[counter] += 2 * (self.counted(counter) - self._offsets[counter])
                self._turns[counter] = -self._turns[counter]
                return
        self._active[fault] = checked

    def clear(self, fault: str | None = None) -> None:
        """Stop showing ``fault``, or all of them; counts that went wrong stay wrong."""
        if fault in (None, "watchdog_dead"):
            self.timer.dead = False
        if fault is None:
            self._active.clear()
        else:
            self._active.pop(fault, None)

    def _act(self) -> None:
        """Bring the outputs to the expiration states."""
        for output, volts in self.timer.volts.items():
            self._give(output, volts)
        self._drive(self.timer.levels)

    def _give(self, output: int, volts: float) -> None:
        self.volts[output] = volts
        wire = self._wires.volts_out.get(output)
        if wire is not None:
            wire(volts)

    def _drive(self, levels: Mapping[str, bool]) -> None:
        self._driven |= levels
        self._wires.lines_out(self.lines)

    def _hits(self, fault: str, option: str, number: int) -> bool:
        options = self._active.get(fault)
        return options is not None and options[option] == number


def _expired() -> DaqFault:
    return DaqFault(_WRITE_EXPIRED, "Write failed because the watchdog timer has expired.")


_OPTIONS: Final[Mapping[str, Mapping[str, Any]]] = {
    "saturation": {"input": range(INPUTS), "rail": ("high", "low")},
    "stuck_code": {"input": range(INPUTS)},
    "open_input": {"input": range(INPUTS)},
    "counter_reset": {"counter": range(COUNTERS)},
    "sign_flip": {"counter": range(COUNTERS)},
}


def _checked(fault: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a fault with their defaults.

    Raises:
        ValueError: there is no such fault, or an option is missing, unknown or out of range.
    """
    if fault not in Terminals.faults:
        raise ValueError(f"there is no fault {fault!r}; there are {', '.join(Terminals.faults)}")
    known = _OPTIONS.get(fault, {})
    for name in given:
        if name not in known:
            raise ValueError(
                f"fault {fault!r} has no option {name!r}; it takes {', '.join(known) or 'none'}"
            )
    options = {name: given.get(name, "high" if name == "rail" else None) for name in known}
    for name, value in options.items():
        if value not in known[name]:
            raise ValueError(f"option {name!r} of fault {fault!r} is {value!r}: {known[name]}")
    return options
