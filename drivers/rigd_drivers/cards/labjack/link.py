"""Operates a LabJack T7 or T4 as a link: devices share its inputs, outputs, counters and lines.

A cycle is two packets of Modbus Feedback: one reads all inputs at its start, one sets all outputs
at its end and feeds the watchdog. Nothing is timed by the device.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from contextlib import suppress
from typing import ClassVar, Final

from rigd.sdk import DeviceError, LinkConfig, LinkError, ProtocolError
from rigd_drivers.cards.card import Card, taken_twice
from rigd_drivers.cards.labjack.config import (
    DAC_SPAN_V,
    TDAC_SPAN_V,
    LabjackConfig,
    LabjackWatchdogOptions,
    tick_of,
)
from rigd_drivers.cards.labjack.device import CALL_S, CYCLE_S, Device
from rigd_drivers.cards.watchdog import prove, prove_one_shot, wires_of

#: Outputs are put out within this time, in s, and at rest over a new connection.
PUT_S: Final = 0.2
PUT_ANEW_S: Final = 0.25
#: More than a device has.
_MOST_INPUTS: Final = 14
_MOST_LINES: Final = 23
#: The inputs convert a little more than +-10 V; beyond these they are not specified.
_RAIL_V: Final = 10.0
#: The watchdog is looked at so often while it is being proven, in s.
_LOOK_S: Final = 0.005
#: After a new connection has failed, none is tried for so long, in s.
AWAY_S: Final = 1.0


class Expired(DeviceError):
    """The watchdog of the device has acted: its digital outputs were brought to rest."""


class Labjack(Card):
    """A LabJack T7 or T4 that gives and takes one sample of each signal in each cycle.

    At rest the analogue outputs give 0 V and the lines stand as ``high_at_rest`` sets. Digital
    lines are those of ``outputs`` and ``inputs``, by their DIO number; an encoder is named by the
    line of its phase A.
    """

    Config: ClassVar[type[LinkConfig]] = LabjackConfig
    title: ClassVar[str] = "LabJack T7 or T4 over Modbus TCP, with its own watchdog"
    reads_on: ClassVar[bool] = True  # outputs are put out by `end` alone
    config: LabjackConfig
    lowest_volts = -_RAIL_V
    highest_volts = _RAIL_V
    count_bits = 32

    def __init__(self, config: LabjackConfig) -> None:
        super().__init__(config)
        self.identity = ""
        self.volts = [math.nan] * _MOST_INPUTS
        self.counts = [0] * _MOST_LINES
        self.indexes = 0
        self.lines = 0
        self.sampled_ns = 0
        self.one_shot_up = True
        self.one_shot_s = config.guard_s
        self._device = Device(config)
        self._spans = [
            DAC_SPAN_V if tick_of(name) is None else TDAC_SPAN_V for name in config.analog_outputs
        ]
        self._open = False
        self._away_until_s = 0.0  # until then it is not tried again
        self._forget()

    def _forget(self) -> None:
        """Use nothing, own nothing, set everything to rest."""
        guard = self.config.guard
        self._taken_volts: set[int] = set()
        self._taken_lines: set[int] = set() if guard is None else {guard.output}
        self._inputs: set[int] = set()
        self._encoders: set[int] = set()
        self._volts_out = [0.0] * len(self.config.analog_outputs)
        self._lines_out = self._device.resting_lines
        self._fed_s: float | None = None  # None: the watchdog is down

    def open(self) -> None:
        """Open the device and bring it to rest: 0 V, lines at rest.

        Raises:
            LinkError: it cannot be reached, or another program drives it.
            DeviceError: it has not what the rig file asks for.
        """
        self.close()
        try:
            self.identity = self._device.open()
        except BaseException:
            self._device.close()
            raise
        self._open, self._away_until_s = True, 0.0

    def close(self) -> None:
        """Bring the outputs to rest and close; closing twice is silent."""
        self._forget()
        if not self._open:
            return
        self._open = False
        with self._device.call_time.within(CALL_S):
            try:
                self._device.rest()
            finally:
                self._device.close()

    def rescue(self) -> None:
        """Bring the outputs to rest over a connection of its own; see :class:`Card`."""
        Device(self.config).rescue()

    def use_inputs(
        self, *, analog: Iterable[int] = (), encoders: Iterable[int] = (), lines: Iterable[int] = ()
    ) -> None:
        """Take these in from now on; see :class:`Card`."""
        config, facts = self.config, self.config.facts
        analog, encoders = sorted(set(analog)), set(encoders)
        self._check_known("analogue input", analog, facts.inputs)
        self._check_known("encoder", encoders - {*config.edge_counters}, facts.phases)
        self._check_known("digital input", lines, config.inputs)
        for each in analog:
            if each in self._inputs or each - 1 in {*config.differential} & self._inputs:
                raise taken_twice("analogue input", each)
            self._inputs.add(each)
        encoders |= {config.index_counters[item] for item in encoders & {*config.index_counters}}
        self._check_phases(encoders)
        self._encoders |= encoders
        if self._open:
            for line in sorted(encoders):
                self._device.use_counter(line)
            for each in analog:
                self._device.use_volts(each)

    def take_outputs(self, *, analog: Iterable[int] = (), lines: Iterable[int] = ()) -> None:
        """Make these outputs the caller's own; see :class:`Card`."""
        for kind, numbers, taken, known in (
            ("analogue output", analog, self._taken_volts, range(len(self._spans))),
            ("digital output", lines, self._taken_lines, self.config.outputs),
        ):
            for number in numbers:
                self._check_known(kind, (number,), known)
                if number in taken:
                    raise taken_twice(kind, number)
                taken.add(number)

    def output_span(self, output: int) -> tuple[float, float]:
        """Return the lowest and the highest volts of an analogue output; see :class:`Card`."""
        self._check_known("analogue output", (output,), range(len(self._spans)))
        return self._spans[output]

    def rests_high(self, line: int) -> bool:
        """Return whether a digital output is high at rest."""
        return line in self.config.high_at_rest

    def set_volts(self, output: int, volts: float) -> None:
        """Set an analogue output, clipped to what it can give, put out with the rest."""
        low, high = self._spans[output]
        self._volts_out[output] = min(max(volts, low), high)

    def set_line(self, line: int, *, high: bool) -> None:
        """Set a digital output, put out with the rest."""
        bit = 1 << line
        self._lines_out = self._lines_out | bit if high else self._lines_out & ~bit

    def begin(self, t_ns: int) -> None:
        """Take in everything that is used.

        Raises:
            LinkError: the device does not answer.
            DeviceError: the device does not do what it should.
        """
        with self._device.call_time.within(CYCLE_S):
            self.sample()

    def end(self, t_ns: int) -> None:
        """Put out what was set, and feed the one-shot or watchdog.

        Raises:
            LinkError: the device does not answer.
            DeviceError: the device takes nothing, or its watchdog has acted.
        """
        with self._device.call_time.within(CYCLE_S):
            self._feed()

    def sample(self) -> None:
        """Take in all that is used now; see :class:`Card`."""
        if not self._open:
            raise LinkError("the card is not open")
        self.sampled_ns = time.monotonic_ns()
        self.lines, values = self._device.scan()
        before = tuple(self.counts)
        for register, value in zip(self._device.scanned, values, strict=True):
            if register.kind == "f":
                self.volts[register.address // 2] = value
            else:
                self.counts[(register.address - 3000) // 2] = int(value)
        self.indexes = sum(
            1 << encoder
            for encoder, counter in self.config.index_counters.items()
            if self.counts[counter] != before[counter]
        )
        guard = self.config.guard
        if guard is not None:
            level = bool(self.lines >> guard.input & 1)
            self.one_shot_up = level == (getattr(guard, "active", "high") == "high")

    def put_out(self) -> None:
        """Put out what has been set now; see :class:`Card`.

        If the connection is of no use, all outputs are brought to rest over a new one. Takes 0.2 s
        at most, and 0.25 s more with a new connection: it delays the stop of all other devices. If
        that fails, it fails at once for a second: each drive of a card calls this as it is made
        safe.
        """
        if not self._open:
            return
        if time.monotonic() < self._away_until_s:
            raise LinkError(f"{self._device} could not be reached again")
        try:
            with self._device.call_time.within(PUT_S):
                self._device.put(self._volts_out, self._lines_out)
        except (LinkError, ProtocolError):
            self._fed_s = None
            self._volts_out = [0.0] * len(self._spans)
            self._lines_out = self._device.resting_lines
            try:
                with self._device.call_time.within(PUT_ANEW_S):
                    self._device.open_anew()
            except (LinkError, ProtocolError):
                self._away_until_s = time.monotonic() + AWAY_S
                raise

    def confirm_outputs(self) -> None:
        """Write all outputs once more, and read the digital ones back; see :class:`Card`."""
        if not self._open:
            return
        self._device.put(self._volts_out, self._lines_out, again=True)
        guard = self.config.guard
        watched = 0 if guard is None else 1 << guard.output  # which may fall meanwhile
        found = self._device.levels()
        for line in self.config.outputs:
            bit = 1 << line
            if (found ^ self._lines_out) & bit & ~watched:
                level = "high" if found & bit else "low"
                raise DeviceError(
                    f"digital output {line} of {self._device} stands {level} against what was "
                    "written",
                    hint="its wire is shorted, or another program writes to the device",
                )

    def prove_one_shot(self) -> float:
        """Raise the one-shot or watchdog, let it drop; see :class:`Card`."""
        guard = self.config.guard
        if isinstance(guard, LabjackWatchdogOptions):
            return self._prove_watchdog(guard)
        return prove_one_shot(guard, self._feed, self._sees_one_shot)

    def _prove_watchdog(self, watchdog: LabjackWatchdogOptions) -> float:
        wires = wires_of(watchdog)
        self._fed_s = None
        try:
            return prove(
                self._feed_patiently, self._sees_one_shot, watchdog.bound_s,
                rises=f"check the wire between {wires}",
                falls=f"check the wire between {wires}, and give `watchdog` more `time` if it "
                "drops later than that",
                name="the watchdog of the card",
            )  # fmt: skip
        finally:
            self._fed_s = None
            self.set_line(watchdog.output, high=False)
            self.put_out()

    def _feed_patiently(self) -> None:
        """Feed the watchdog; one that has acted by a stall of this machine begins again."""
        with suppress(Expired):
            self._feed()

    def _feed(self) -> None:
        """Put out what was set and feed the guard.

        The device takes new levels after its watchdog has acted. So it is looked at before each
        write, by the clock and by the level of its line: what it has switched off stays off.
        """
        config, device = self.config, self._device
        watchdog, one_shot = config.watchdog, config.one_shot
        if one_shot is not None:
            self._lines_out ^= 1 << one_shot.output
        if watchdog is None:
            device.put(self._volts_out, self._lines_out)
            return
        fed_s, now_s = self._fed_s, time.monotonic()
        if fed_s is not None and now_s - fed_s > watchdog.timeout:
            raise self._expired()
        bit = 1 << watchdog.output
        self._lines_out |= bit
        before = device.put(self._volts_out, self._lines_out, feed=True)
        if fed_s is not None and not before & bit:
            raise self._expired()
        self._fed_s = now_s

    def _expired(self) -> Expired:
        """Bring what it guards to rest again, and return the error."""
        self._fed_s = None
        self._lines_out = self._device.resting_lines
        with suppress(LinkError, ProtocolError, DeviceError):
            self._device.put([0.0] * len(self._spans), self._lines_out, again=True)
        return Expired(
            f"the watchdog of {self._device} has acted: its digital outputs were brought to rest",
            hint="this computer or the network stalled; give `watchdog` more `timeout`, or see "
            "'rigd doctor'",
        )

    def _sees_one_shot(self) -> bool:
        time.sleep(_LOOK_S)
        self.sample()
        return self.one_shot_up

    def _check_phases(self, encoders: Iterable[int]) -> None:
        """Check that the lines of each encoder are not used otherwise."""
        config = self.config
        used = {*config.outputs, *config.inputs, *config.tick_lines}
        for encoder in encoders:
            edges = encoder in config.edge_counters
            for line in () if edges else (encoder, encoder + 1):
                if line in used or line in config.edge_counters:
                    raise LinkError(
                        f"encoder {encoder} needs lines {encoder} and {encoder + 1}; line {line} "
                        "is used otherwise in the options of the link",
                        hint="wire the encoder or that signal to other lines",
                    )

    def _check_known(self, what: str, numbers: Iterable[int], known: Iterable[int]) -> None:
        have = sorted(known)
        for number in numbers:
            if number not in have:
                listed = ", ".join(map(str, have)) or "none"
                raise LinkError(
                    f"the LabJack {self.config.product} of the rig file has no {what} {number}; it "
                    f"has {listed}"
                )
