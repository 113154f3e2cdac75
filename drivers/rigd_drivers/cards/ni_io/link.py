"""Operates an NI card as a link: devices share its inputs, outputs, counters and lines.

The link reads all inputs at the start of a cycle and writes all outputs at its end, each by a call
to NI-DAQmx. Nothing is timed by the card.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from contextlib import suppress
from typing import ClassVar, Final

from rigd.sdk import LinkConfig, LinkError
from rigd_drivers.cards.card import Card, Train, taken_twice
from rigd_drivers.cards.ni_io.config import NiIoConfig, WatchdogOptions
from rigd_drivers.cards.ni_io.signals import CALL_S, CYCLE_S, RANGE_V, Expired, Signals
from rigd_drivers.cards.watchdog import prove, prove_one_shot, wires_of

#: Outputs are put out within this time, in s: it delays the stop of all other devices.
PUT_S: Final = 0.4
#: More analogue inputs or counters than a card has.
_MOST_INPUTS: Final = 80
_MOST_COUNTERS: Final = 8
#: At a rail: 13 bits, the coarsest converter, end 2.4 mV below the range.
_RAIL_V: Final = RANGE_V - 0.005
#: The watchdog of the card is fed so often within its time, not in every cycle.
_FEEDS_PER_TIME: Final = 5


class NiIo(Card):
    """An NI card that gives and takes one sample of each signal in each cycle.

    A cycle waits for a call to the card for the analogue inputs, the digital inputs and each
    counter in use, for one more if a counter has timed pulses, and for one for the analogue and the
    digital outputs if they have changed. At rest, from its opening until it is closed, the outputs
    give 0 V and the lines stand as ``high_at_rest`` sets.
    """

    Config: ClassVar[type[LinkConfig]] = NiIoConfig
    title: ClassVar[str] = "NI card with outputs and counters, one sample in each cycle"
    reads_on: ClassVar[bool] = True  # outputs are put out by `end` alone
    config: NiIoConfig
    lowest_volts = -_RAIL_V
    highest_volts = _RAIL_V
    count_bits = 32

    def __init__(self, config: NiIoConfig) -> None:
        super().__init__(config)
        self.identity = ""
        self.volts = [math.nan] * _MOST_INPUTS
        self.counts = [0] * _MOST_COUNTERS
        self.indexes = 0
        self.lines = 0
        self.sampled_ns = 0
        self.one_shot_up = True
        self.one_shot_s = None if config.guard is None else config.guard.time
        self._signals = Signals(config)
        self._open = False
        self._forget()

    def _forget(self) -> None:
        """Use nothing, own nothing, set everything to rest."""
        guard = self.config.guard
        self._scan: tuple[int, ...] = ()
        self._encoders: tuple[int, ...] = ()
        self.trains = {}
        self._taken_volts: set[int] = set()
        self._taken_lines: set[int] = set() if guard is None else {guard.output}
        self._volts_out = [0.0] * self.config.analog_outputs
        self._lines_out = self._signals.resting_lines

    def open(self) -> None:
        """Open the card and bring it to rest: 0 V, lines at rest.

        Raises:
            LinkError: there is no such card, or another program uses it.
            DeviceError: it has not what the rig file asks for.
        """
        self.close()
        try:
            self.identity = self._signals.open()
        except BaseException:
            self._signals.close()
            raise
        self._open = True

    def close(self) -> None:
        """Bring the outputs to rest and close; closing twice is silent."""
        self._forget()
        if not self._open:
            return
        self._open = False
        with self._signals.call_time.within(CALL_S):
            try:
                with suppress(Expired):  # they are at rest
                    self._signals.rest()
                self._signals.end_watchdog()
            finally:
                self._signals.close()

    def rescue(self) -> None:
        """Bring the outputs to rest over a connection of its own; see :class:`Card`."""
        self._signals.rescue()

    def use_inputs(
        self, *, analog: Iterable[int] = (), encoders: Iterable[int] = (), lines: Iterable[int] = ()
    ) -> None:
        """Take these in from now on; see :class:`Card`."""
        analog, encoders = set(analog), set(encoders)
        _check_known("analogue input", analog, _MOST_INPUTS)
        _check_known("counter", encoders, _MOST_COUNTERS)
        _check_known("digital input", lines, len(self.config.inputs))
        for each in sorted(analog & set(self._scan)):
            raise taken_twice("analogue input", each)
        for each in sorted(encoders & {*self.trains}):
            raise taken_twice("counter", each)
        indexes = {self.config.index_counters[e] for e in encoders & {*self.config.index_counters}}
        self._scan = tuple(sorted({*self._scan, *analog}))
        self._encoders = tuple(sorted({*self._encoders, *encoders, *indexes}))
        if self._open:
            for counter in self._encoders:
                self._signals.use_counter(counter)
            if analog:
                self._signals.use_volts(self._scan)

    def use_pulses(self, counter: int, *, longest_s: float, width: bool) -> None:
        """Time these pulses from now on; see :class:`Card`."""
        _check_known("counter", (counter,), _MOST_COUNTERS)
        if counter in self.config.edge_counters:
            raise LinkError(
                f"counter {counter} counts edges, and cannot time pulses as well",
                hint="remove it from `edge_counters`, or correct `counter`",
            )
        if counter in self.trains or counter in self._encoders:
            raise taken_twice("counter", counter)
        if self._open:
            self._signals.use_pulses(counter, longest_s=longest_s, width=width)
        self.trains[counter] = Train()

    def take_outputs(self, *, analog: Iterable[int] = (), lines: Iterable[int] = ()) -> None:
        """Make these outputs the caller's own; see :class:`Card`."""
        for kind, numbers, taken, count in (
            ("analogue output", analog, self._taken_volts, self.config.analog_outputs),
            ("digital output", lines, self._taken_lines, len(self.config.outputs)),
        ):
            for number in numbers:
                _check_known(kind, (number,), count)
                if number in taken:
                    raise taken_twice(kind, number)
                taken.add(number)

    def rests_high(self, line: int) -> bool:
        """Return whether a digital output is high at rest."""
        return line in self.config.high_at_rest

    def set_volts(self, output: int, volts: float) -> None:
        """Set an analogue output, clipped to what it can give, put out with the rest."""
        self._volts_out[output] = min(max(volts, -RANGE_V), RANGE_V)

    def set_line(self, line: int, *, high: bool) -> None:
        """Set a digital output, put out with the rest."""
        self._lines_out[line] = high

    def begin(self, t_ns: int) -> None:
        """Take in everything that is used.

        Raises:
            LinkError: the card or its server does not answer.
            DeviceError: the card does not do what it should.
        """
        with self._signals.call_time.within(CYCLE_S):
            self.sample()

    def end(self, t_ns: int) -> None:
        """Put out what was set, and feed the one-shot or watchdog.

        Raises:
            LinkError: the card or its server does not answer.
            DeviceError: the card takes nothing, or its watchdog has expired.
        """
        watchdog, signals = self.config.watchdog, self._signals
        with signals.call_time.within(CYCLE_S):
            if watchdog is not None and not signals.watched:
                signals.start_watchdog(watchdog)
            self._feed()

    def sample(self) -> None:
        """Take in all that is used now; see :class:`Card`."""
        if not self._open:
            raise LinkError("the card is not open")
        self.sampled_ns = time.monotonic_ns()
        signals = self._signals
        for number, volts in zip(self._scan, signals.volts(), strict=True):
            self.volts[number] = volts
        before = tuple(self.counts)
        for counter in self._encoders:
            self.counts[counter] = signals.count(counter)
        self.indexes = sum(
            1 << encoder
            for encoder, counter in self.config.index_counters.items()
            if self.counts[counter] != before[counter]
        )
        for counter in self.trains:
            self.trains[counter] = signals.train(counter)
        levels = signals.levels()
        self.lines = sum(1 << line for line, high in enumerate(levels) if high)
        guard = self.config.guard
        if guard is not None:
            self.one_shot_up = levels[guard.input] == (getattr(guard, "active", "high") == "high")

    def put_out(self) -> None:
        """Put out what has been set now; see :class:`Card`."""
        self._put(again=False)

    def confirm_outputs(self) -> None:
        """Write all outputs once more, and wait for the answer; see :class:`Card`."""
        self._put(again=True)

    def prove_one_shot(self) -> float:
        """Raise the one-shot or watchdog, let it drop; see :class:`Card`."""
        guard = self.config.guard
        if isinstance(guard, WatchdogOptions):
            return self._prove_watchdog(guard)
        return prove_one_shot(guard, self._feed, self._sees_one_shot)

    def _prove_watchdog(self, watchdog: WatchdogOptions) -> float:
        wires = wires_of(watchdog)
        self._signals.end_watchdog()
        try:
            self._signals.start_watchdog(watchdog)
            return prove(
                self._feed_patiently, self._sees_one_shot, watchdog.time,
                rises=f"check the wire between {wires}",
                falls=f"check the wire between {wires}, and whether the card has a watchdog timer",
                name="the watchdog of the card",
            )  # fmt: skip
        finally:
            self._signals.end_watchdog()
            self._lines_out[watchdog.output] = False
            self._put(again=True)

    def _feed_patiently(self) -> None:
        """Feed the watchdog; one that has expired by a stall of this machine begins again."""
        try:
            self._feed()
        except Expired:
            self._signals.unlock()

    def _feed(self) -> None:
        guard, signals = self.config.guard, self._signals
        if guard is not None:
            watchdog = isinstance(guard, WatchdogOptions)
            self._lines_out[guard.output] = watchdog or not self._lines_out[guard.output]
        signals.put(self._volts_out, self._lines_out)
        if guard is not None and signals.watched:
            signals.feed(guard.time / _FEEDS_PER_TIME)

    def _sees_one_shot(self) -> bool:
        self.sample()
        return self.one_shot_up

    def _put(self, *, again: bool) -> None:
        if not self._open:
            return
        try:
            with self._signals.call_time.within(PUT_S):
                self._signals.put_lines_first(self._volts_out, self._lines_out, again=again)
        except Expired:
            if not self._at_rest():
                raise

    def _at_rest(self) -> bool:
        """Return whether what was set is what the watchdog has put out already."""
        guard = self.config.guard
        lines = zip(self._lines_out, self._signals.resting_lines, strict=True)
        return not any(self._volts_out) and all(
            level == rest or (guard is not None and line == guard.output)
            for line, (level, rest) in enumerate(lines)
        )


def _check_known(what: str, numbers: Iterable[int], count: int) -> None:
    for number in numbers:
        if not 0 <= number < count:
            have = f"it has 0 to {count - 1}" if count else "the rig file gives it none"
            raise LinkError(f"the NI card has no {what} {number}; {have}")
