"""Operates the Humusoft MF624 as a link, an opened connection that devices share.

The link reads all inputs in one scan at the start of a cycle and sets all outputs at its end.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from importlib.metadata import entry_points
from typing import Annotated, ClassVar, Final, Literal

from annotated_types import Ge, Gt, Le, Lt
from pydantic import field_validator

from rigd.sdk import DeviceError, Documented, In, LinkConfig, LinkError
from rigd_drivers.cards.card import Card, taken_twice
from rigd_drivers.cards.mf624 import registers as mf
from rigd_drivers.cards.mf624.access import BUILT_IN, PLUGINS, RegIO, open_registers
from rigd_drivers.cards.watchdog import prove

Line = Annotated[int, Ge(0), Lt(mf.LINES)]

#: Reads of GPIOC until a conversion counts as stuck. A read over PCI takes 0.5 us or more and a
#: scan of eight inputs less than 4 us, so that this is ten times what it needs.
_EOLC_READS: Final = 100


class ReferenceOptions(Documented):
    """An analogue input wired to a known voltage."""

    input: Annotated[int, Ge(0), Lt(mf.ANALOG_INPUTS)]
    """The input; above all others in use, so that it is converted last."""
    voltage: Annotated[float, In("V"), Gt(-10), Lt(10)]
    """What it is wired to; far from 0 V, which an open input may show."""
    tolerance: Annotated[float, In("V"), Gt(0), Le(1)] = 0.2
    """How far it may be off."""


class OneShotOptions(Documented):
    """A retriggerable one-shot that gates the enable lines of the drives on this card."""

    output: Line
    """Digital output that retriggers it, toggled at the end of every cycle."""
    time: Annotated[float, In("s"), Ge(0.001), Le(1)]
    """Longest time it stays up after the last edge, with the tolerance of its parts."""
    input: Line
    """Digital input wired to its output, by which it is proven and watched."""
    active: Literal["high", "low"] = "high"
    """Level of that input while it is up."""


class Mf624Config(LinkConfig):
    """The options of the card, and the wiring beyond the devices."""

    interface: str = "uio"
    """`uio` for a card in this computer, `emulator` for one of `rigd sim`, or the name of an
    installed entry point of group `rigd_drivers.mf624`."""
    resource: str = "/dev/uio0"
    """The device file, the socket of the emulator, or what the entry point takes."""
    high_at_rest: tuple[Line, ...] = ()
    """Digital outputs that stand high while nothing is driven, such as enable lines that are
    active low; all others stand low. The card wakes with all of them low: what is active low must
    be held off by its wiring until rigd has opened the card."""
    encoder_filter: bool = True
    """Whether the encoder inputs suppress pulses too short to be the encoder's."""
    reference: ReferenceOptions | None = None
    """Input on a known voltage: the only way to see that a scan came short or shifted, or that
    the converter is off."""
    one_shot: OneShotOptions | None = None
    """External watchdog. The card has none: when this computer dies, its outputs hold."""

    @field_validator("interface")
    @classmethod
    def _installed(cls, name: str) -> str:
        known = [*BUILT_IN, *sorted(point.name for point in entry_points(group=PLUGINS))]
        if name not in known:
            raise ValueError(f"no way {name!r} to the registers; one of {', '.join(known)}")
        return name


class Mf624(Card):
    """A Humusoft MF624: 8 analogue inputs and outputs, 4 encoders, 8 lines in and 8 out.

    All inputs of a scan are converted at one moment (MF 624 manual: simultaneous sampling), and
    all analogue outputs change together. At rest the outputs give 0 V and the lines stand as
    ``high_at_rest`` sets; :meth:`close` leaves the card in the same state.
    """

    Config: ClassVar[type[LinkConfig]] = Mf624Config
    title: ClassVar[str] = "Humusoft MF624 data acquisition card"
    reads_on: ClassVar[bool] = True  # outputs are put out by `end` alone
    config: Mf624Config
    lowest_volts = mf.LOWEST_VOLTS
    highest_volts = mf.HIGHEST_VOLTS
    count_bits = 32

    def __init__(self, config: Mf624Config) -> None:
        super().__init__(config)
        self.identity = ""
        self.volts = [math.nan] * mf.ANALOG_INPUTS
        self.counts = [0] * mf.ENCODERS
        self.indexes = 0
        self.lines = 0
        self.sampled_ns = 0
        self.one_shot_up = True
        self.one_shot_s = None if config.one_shot is None else config.one_shot.time
        self._io: RegIO | None = None
        self._rest = mf.mask_of(config.high_at_rest)
        self._forget()

    def _forget(self) -> None:
        """Use nothing, own nothing, set everything to rest."""
        reference, one_shot = self.config.reference, self.config.one_shot
        self._scan: tuple[int, ...] = () if reference is None else (reference.input,)
        self._adctrl = mf.mask_of(self._scan)
        self._encoders: tuple[int, ...] = ()
        self._codes: dict[int, int] = {}
        self._own_lines = 0 if one_shot is None else 1 << one_shot.output
        self._dout = self._rest

    def connect(self, *, alone: bool) -> RegIO:
        """Open the way to the registers; see :func:`open_registers`."""
        return open_registers(self.config.interface, self.config.resource, alone=alone)

    def open(self) -> None:
        """Open the card and bring it to rest: 0 V, lines at rest, outputs driven.

        Raises:
            LinkError: there is no such card, or another process drives it.

        """
        self.close()
        io = self.connect(alone=True)
        try:
            _check_present(io.r32(mf.GPIOC))
            _rest(io, self._rest)
            io.w32(mf.GPIOC, mf.GPIOC_BASE | mf.DACEN)
            io.w32(mf.INTCSR, 0)
            io.w32(mf.IRCCTRL, mf.irc_control(filtered=self.config.encoder_filter))
            for _ in range(mf.FIFO_WORDS):  # what a process killed in mid-scan left there
                io.r16(mf.ADDATA)
        except BaseException:
            io.close()
            raise
        self._io = io
        self.identity = f"Humusoft MF624 at {self.config.resource}"

    def close(self) -> None:
        """Bring the outputs to rest and close; closing twice is silent."""
        io, self._io = self._io, None
        self._forget()
        if io is None:
            return
        try:
            _rest(io, self._rest)
            io.w32(mf.GPIOC, mf.GPIOC_BASE | mf.DACEN)
        finally:
            io.close()

    def rescue(self) -> None:
        """Bring the outputs to rest over a connection of its own and tie them to ground."""
        io = self.connect(alone=False)
        try:
            _check_present(io.r32(mf.GPIOC))
            _rest(io, self._rest)
            io.w32(mf.GPIOC, mf.GPIOC_BASE)
            _check_present(io.r32(mf.GPIOC))  # also: what was posted has arrived
        finally:
            io.close()

    def use_inputs(
        self, *, analog: Iterable[int] = (), encoders: Iterable[int] = (), lines: Iterable[int] = ()
    ) -> None:
        """Take these in from now on; see :class:`Card`."""
        analog, encoders = set(analog), set(encoders)
        _check_known("analogue input", analog, mf.ANALOG_INPUTS)
        _check_known("encoder", encoders, mf.ENCODERS)
        _check_known("digital input", lines, mf.LINES)
        reference = self.config.reference
        if reference is not None and analog and max(analog) >= reference.input:
            raise LinkError(
                f"analogue input {max(analog)} is not below input {reference.input}, the reference",
                hint="wire the reference to an input above all others",
            )
        for each in analog & set(self._scan):
            raise taken_twice("analogue input", each)
        self._scan = tuple(sorted({*self._scan, *analog}))
        self._adctrl = mf.mask_of(self._scan)
        self._encoders = tuple(sorted({*self._encoders, *encoders}))

    def take_outputs(self, *, analog: Iterable[int] = (), lines: Iterable[int] = ()) -> None:
        """Make these outputs the caller's own; see :class:`Card`."""
        analog, lines = tuple(analog), tuple(lines)
        _check_known("analogue output", analog, mf.ANALOG_OUTPUTS)
        _check_known("digital output", lines, mf.LINES)
        for output in analog:
            if output in self._codes:
                raise taken_twice("analogue output", output)
        for line in lines:
            if self._own_lines >> line & 1:
                raise taken_twice("digital output", line)
        self._codes |= dict.fromkeys(analog, mf.ZERO_VOLTS)
        self._own_lines |= mf.mask_of(lines)

    def rests_high(self, line: int) -> bool:
        """Return whether a digital output is high at rest."""
        return bool(self._rest >> line & 1)

    def set_volts(self, output: int, volts: float) -> None:
        """Set an analogue output, clipped to what it can give, put out with the rest."""
        self._codes[output] = mf.code_of(volts)

    def set_line(self, line: int, *, high: bool) -> None:
        """Set a digital output, put out with the rest."""
        bit = 1 << line
        self._dout = self._dout | bit if high else self._dout & ~bit

    def begin(self, t_ns: int) -> None:
        """Take in everything that is used.

        Raises:
            LinkError: the card is gone, or its converter does not do what it should.

        """
        self.sample()

    def end(self, t_ns: int) -> None:
        """Put out what was set, and retrigger the one-shot.

        Raises:
            LinkError: the card is gone.

        """
        self._retrigger()
        self.put_out()

    def sample(self) -> None:
        """Take in all that is used now; see :class:`Card`."""
        io = self._opened()
        self.sampled_ns = time.monotonic_ns()
        if self._scan:
            io.w16(mf.ADCTRL, self._adctrl)
            io.r16(mf.ADSTART)
        # While the converter works: the counters, and the lines.
        for encoder in self._encoders:
            self.counts[encoder] = io.r32(mf.irc(encoder))
        if self._encoders:
            self.indexes = mf.index_bits(io.r32(mf.IRCSTATUS))
        self.lines = io.r16(mf.DIN) & 0xFF
        one_shot = self.config.one_shot
        if one_shot is not None:
            high = bool(self.lines >> one_shot.input & 1)
            self.one_shot_up = high == (one_shot.active == "high")
        self._await_conversion(io)
        for channel in self._scan:
            self.volts[channel] = mf.volts_of(io.r16(mf.ADDATA))
        reference = self.config.reference
        if reference is not None:
            found = self.volts[reference.input]
            if abs(found - reference.voltage) > reference.tolerance:
                raise LinkError(
                    f"analogue input {reference.input} reads {found:.3f} V, it is wired to "
                    f"{reference.voltage:g} V: the scan came short or shifted, or the converter "
                    "is not right",
                    hint="no input of this card is valid; check the wire of the reference, "
                    "then the card",
                )

    def _await_conversion(self, io: RegIO) -> None:
        """Wait until the conversion is over; see it, too, when the card is gone."""
        for _ in range(_EOLC_READS):
            gpioc = io.r32(mf.GPIOC)
            if not gpioc & mf.EOLC:
                return
            _check_present(gpioc)
        raise LinkError(
            f"the converter has not finished {len(self._scan)} inputs within {_EOLC_READS} reads "
            "of its status (EOLC stays set)",
            hint="the card hangs: switch the computer off and on; then replace the card",
        )

    def put_out(self) -> None:
        """Put out what has been set now; see :class:`Card`."""
        io = self._io
        if io is None:
            return
        if self._codes:
            io.w32(mf.GPIOC, mf.GPIOC_BASE | mf.DACEN | mf.LDAC)
            for output, code in self._codes.items():
                io.w16(mf.da(output), code)
            io.w32(mf.GPIOC, mf.GPIOC_BASE | mf.DACEN)
        io.w16(mf.DOUT, self._dout)

    def confirm_outputs(self) -> None:
        """Read a register, which a write cannot be later than; see :class:`Card`."""
        if self._io is not None:
            _check_present(self._io.r32(mf.GPIOC))

    def prove_one_shot(self) -> float:
        """Raise the one-shot, let it drop; see :class:`Card`."""
        one_shot = self.config.one_shot
        if one_shot is None:
            raise DeviceError(
                "no one-shot is declared on this card",
                hint="add 'one_shot' to the options of the link, or a waiver to the device",
            )
        return prove(
            self._feed,
            self._sees_one_shot,
            one_shot.time,
            fed=f"digital output {one_shot.output} toggles",
            rises=f"check the wires to it and from it to digital input {one_shot.input}, and "
            f"whether that is really '{one_shot.active}' while it is up",
            falls=f"check its resistor and capacitor, and the wire to digital input "
            f"{one_shot.input}",
        )

    def _feed(self) -> None:
        self._retrigger()
        self.put_out()

    def _sees_one_shot(self) -> bool:
        self.sample()
        return self.one_shot_up

    def _retrigger(self) -> None:
        if self.config.one_shot is not None:
            self._dout ^= 1 << self.config.one_shot.output

    def _opened(self) -> RegIO:
        if self._io is None:
            raise LinkError("the card is not open")
        return self._io


def _rest(io: RegIO, lines: int) -> None:
    """Bring lines to rest first, then all outputs to 0 V; they hold until GPIOC is written.

    The card wakes with full-scale codes in its outputs, tied to ground: codes before DACEN.
    """
    io.w16(mf.DOUT, lines)
    for output in range(mf.ANALOG_OUTPUTS):
        io.w16(mf.da(output), mf.ZERO_VOLTS)


def _check_present(gpioc: int) -> None:
    if gpioc == mf.ABSENT:
        raise LinkError(
            "the MF624 is gone: every bit of its registers reads 1",
            hint="check that the card sits in its slot and has power, then restart the computer",
        )


def _check_known(what: str, numbers: Iterable[int], count: int) -> None:
    for number in numbers:
        if not 0 <= number < count:
            raise LinkError(f"an MF624 has no {what} {number}; it has 0 to {count - 1}")
