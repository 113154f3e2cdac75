"""Simulates the registers of the Humusoft MF624, including the side effects of a read.

Sources: the MF 624 User's Manual, and the description of the registers in the Linux drivers of the
card. If the sources leave a behaviour open, the simulation takes the worst case for the driver:

* a FIFO keeps the values that no read has taken;
* an empty FIFO reads as all ones;
* the outputs start at full scale (tied to ground until DACEN).

The card has no watchdog: its outputs keep their values when the master stops or crashes.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final

Register = tuple[int, int]

INPUTS: Final = 8
OUTPUTS: Final = 8
ENCODERS: Final = 4

_GPIOC: Final = (0, 0x54)
_DIO: Final = (2, 0x10)
_ADCTRL: Final = (2, 0x00)
_ADSTART: Final = (2, 0x20)
_FIFO: Final = tuple((2, offset) for offset in range(0, 0x10, 2))
_DACS: Final = {(2, 0x20 + 2 * output): output for output in range(OUTPUTS)}
_IRCS: Final = {(4, 0x70 + 4 * encoder): encoder for encoder in range(ENCODERS)}
_IRC_STATUS: Final = (4, 0x6C)

_EOLC: Final = 1 << 17
_LDAC: Final = 1 << 23
_DACEN: Final = 1 << 26
_GPIOC_FIXED: Final = 0x024006C0
_FIFO_DEPTH: Final = 8
_POWER_ON_CODE: Final = 0x3FFF

#: Mains that an open input picks up: V, Hz.
_PICKUP_V: Final = 3.0
_MAINS_HZ: Final = 50.0

#: The options of faults, and what each may be.
_INPUT: Final = {"input": tuple(range(INPUTS))}
_ENCODER: Final = {"encoder": tuple(range(ENCODERS))}
_OPTIONS: Final[Mapping[str, Mapping[str, tuple[object, ...]]]] = {
    "fifo_short": {"words": tuple(range(1, _FIFO_DEPTH + 1))},
    "saturation": {**_INPUT, "rail": ("high", "low")},
    "stuck_code": _INPUT,
    "open_input": _INPUT,
    "index_reset": _ENCODER,
    "sign_flip": _ENCODER,
}
_DEFAULTS: Final[Mapping[str, object]] = {"words": 1, "rail": "high"}


def _nothing() -> None:
    """For a card without physics to advance."""


def _no_lines(lines: int) -> None:
    """For a card with nothing wired to the digital outputs."""


@dataclass(frozen=True)
class Wires:
    """What is wired to the card: volts in V, counts as the encoder has made them.

    ``advance`` brings the physics behind the wires to now; it is called before they are read.
    An analogue input without a wire reads 0 V, an encoder without one stands still. A counter that
    times pulses takes each count as one; ``duty_in`` is the part of its period at high level, half
    of it without a wire.
    """

    volts_in: Mapping[int, Callable[[], float]] = field(default_factory=dict)
    volts_out: Mapping[int, Callable[[float], None]] = field(default_factory=dict)
    counts_in: Mapping[int, Callable[[], int]] = field(default_factory=dict)
    duty_in: Mapping[int, Callable[[], float]] = field(default_factory=dict)
    index_in: Mapping[int, Callable[[], bool]] = field(default_factory=dict)
    lines_in: Callable[[], int] = lambda: 0
    lines_out: Callable[[int], None] = _no_lines
    advance: Callable[[], None] = _nothing


class Mf624Registers:
    """The register file; an access is a call, with all that it does on the card.

    Args:
        wires: what the card is wired to.
        clock_ns: for what depends on time alone, such as mains pick-up.

    """

    faults: ClassVar[Mapping[str, str]] = {
        "eolc_stuck": "a conversion never ends",
        "fifo_short": "the FIFO misses the last words (words=1)",
        "saturation": "an analogue input stands at a rail (input, rail=high|low)",
        "stuck_code": "an analogue input always gives the code it gave last (input)",
        "open_input": "an analogue input is open and picks up mains (input)",
        "index_reset": "an encoder's counter starts from zero again, once (encoder)",
        "sign_flip": "an encoder counts the wrong way from now on (encoder)",
        "card_removed": "every read gives all ones, writes are lost",
    }

    def __init__(self, wires: Wires, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._wires = wires
        self._clock_ns = clock_ns
        self._gpioc = _GPIOC_FIXED
        self._channels: tuple[int, ...] = ()
        self._fifo: deque[int] = deque(maxlen=_FIFO_DEPTH)
        self._busy = 0
        self._codes = [_POWER_ON_CODE] * OUTPUTS
        self._latched = list(self._codes)
        self._last_words = [0] * INPUTS
        self._turns = [1] * ENCODERS  # the sign of each encoder, and what its counter is off by
        self._offsets = [0] * ENCODERS
        self._active: dict[str, dict[str, Any]] = {}
        self.volts = [0.0] * OUTPUTS  #: what the analogue outputs give, in V
        self.lines = 0  #: digital outputs, a bit each

    def r16(self, register: Register) -> int:
        """Read a 16-bit register."""
        if "card_removed" in self._active:
            return 0xFFFF
        if register in _FIFO:
            return self._pop()
        if register == _DIO:
            self._wires.advance()
            return self._wires.lines_in() & 0xFF
        if register == _ADSTART:
            self._start()
        return 0xFFFF

    def w16(self, register: Register, value: int) -> None:
        """Write a 16-bit register."""
        if "card_removed" in self._active:
            return
        output = _DACS.get(register)
        if output is not None:
            self._codes[output] = value & 0x3FFF
            if not self._gpioc & _LDAC:
                self._latched[output] = self._codes[output]
                self._drive()
        elif register == _DIO:
            self.lines = value & 0xFF
            self._wires.lines_out(self.lines)
        elif register == _ADCTRL:
            self._channels = tuple(item for item in range(INPUTS) if value >> item & 1)

    def r32(self, register: Register) -> int:
        """Read a 32-bit register; at the FIFO it pops two words."""
        if "card_removed" in self._active:
            return 0xFFFF_FFFF
        if register == _GPIOC:
            return self._gpioc | self._converting()
        encoder = _IRCS.get(register)
        if encoder is not None:
            self._wires.advance()
            return self._count(encoder)
        if register == _IRC_STATUS:
            return sum(seen() << (8 * item) for item, seen in self._wires.index_in.items())
        return self.r16(register) | self.r16((register[0], register[1] + 2)) << 16

    def w32(self, register: Register, value: int) -> None:
        """Write a 32-bit register."""
        if "card_removed" in self._active or register != _GPIOC:
            return  # interrupts and encoder modes: nothing to show
        self._gpioc = _GPIOC_FIXED | value & (_LDAC | _DACEN)
        if not value & _LDAC:
            self._latched[:] = self._codes
        self._drive()

    def close(self) -> None:
        """Do nothing: the card keeps its state."""

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault from now on; the options stand in :attr:`faults`.

        Raises:
            ValueError: there is no such fault, or not with these options.

        """
        if fault not in self.faults:
            raise ValueError(f"an MF624 has no fault {fault!r}; it knows {', '.join(self.faults)}")
        checked = _checked(fault, options)
        if fault == "index_reset":
            found = checked["encoder"]
            self._offsets[found] = -self._turns[found] * self._wires.counts_in.get(found, int)()
            return
        if fault == "sign_flip":
            found = checked["encoder"]
            self._offsets[found] += 2 * self._turns[found] * self._wires.counts_in.get(found, int)()
            self._turns[found] = -self._turns[found]
        self._active[fault] = checked

    def clear(self, fault: str | None = None) -> None:
        """Stop showing ``fault``, or all of them; counts that went wrong stay wrong."""
        if fault is None:
            self._active.clear()
        else:
            self._active.pop(fault, None)

    def _start(self) -> None:
        self._wires.advance()
        self._busy = 1
        words = [self._convert(channel) for channel in self._channels]
        short = self._active.get("fifo_short")
        self._fifo.extend(words if short is None else words[: len(words) - short["words"]])

    def _convert(self, channel: int) -> int:
        if self._hits("stuck_code", channel):
            return self._last_words[channel]
        if self._hits("saturation", channel):
            volts = 99.0 if self._active["saturation"]["rail"] == "high" else -99.0
        elif self._hits("open_input", channel):
            volts = _PICKUP_V * math.sin(2e-9 * math.pi * _MAINS_HZ * self._clock_ns())
        else:
            volts = self._wires.volts_in.get(channel, float)()
        code = min(max(round(volts * 819.2), -8192), 8191)
        self._last_words[channel] = word = code & 0x3FFF
        return word

    def _hits(self, fault: str, channel: int) -> bool:
        options = self._active.get(fault)
        return options is not None and options["input"] == channel

    def _converting(self) -> int:
        """Return the EOLC bit: a conversion still runs at the first read, then it is over."""
        if "eolc_stuck" in self._active:
            return _EOLC
        busy, self._busy = self._busy, 0
        return _EOLC if busy else 0

    def _pop(self) -> int:
        return self._fifo.popleft() if self._fifo and not self._busy else 0xFFFF

    def _count(self, encoder: int) -> int:
        made = self._wires.counts_in.get(encoder, int)()
        return (self._turns[encoder] * made + self._offsets[encoder]) & 0xFFFF_FFFF

    def _drive(self) -> None:
        driven = self._gpioc & _DACEN
        for output, code in enumerate(self._latched):
            volts = code * 20.0 / 0x4000 - 10.0 if driven else 0.0
            if volts != self.volts[output]:
                self.volts[output] = volts
                wire = self._wires.volts_out.get(output)
                if wire is not None:
                    wire(volts)


def _checked(fault: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a fault with their defaults.

    Raises:
        ValueError: one is missing, unknown, or out of range.

    """
    known = _OPTIONS.get(fault, {})
    for name in given:
        if name not in known:
            raise ValueError(
                f"fault {fault!r} has no option {name!r}; it takes {', '.join(known) or 'none'}"
            )
    options = {name: given.get(name, _DEFAULTS.get(name)) for name in known}
    for name, value in options.items():
        if value not in known[name]:
            found = "is missing" if value is None else f"is {value!r}"
            raise ValueError(f"option {name!r} of fault {fault!r} {found}; one of {known[name]}")
    return options
