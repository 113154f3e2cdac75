"""Reads and sets the inputs, outputs, counters and watchdog of one LabJack T7 or T4."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Final

from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd_drivers.call_time import CallTime
from rigd_drivers.cards.labjack import registers as lj
from rigd_drivers.cards.labjack.config import LabjackConfig, LabjackWatchdogOptions, tick_of
from rigd_drivers.cards.labjack.connection import Connection
from rigd_drivers.cards.labjack.registers import Packet, Register, Write, packet
from rigd_drivers.wait import looks

#: How long connecting may take, in s,
OPEN_S: Final = 2.0
#: or connecting again as its outputs are made safe,
ANEW_S: Final = 0.2
#: the longest answer outside of a cycle,
CALL_S: Final = 0.5
#: and all answers of one half of a cycle together: it must report a device that is away before it
#: counts as silent itself (250 ms in the shipped rigs).
CYCLE_S: Final = 0.15
#: What must be written to feed the watchdog in strict mode; any other program lacks it.
_KEY: Final = 0x72696764
#: A guard line is looked at so often, in s.
_LOOK_S: Final = 0.02
#: No analogue input of +-10 V converts to more; an input that has failed reads -9999.
_MOST_V: Final = 12.0
#: Oldest firmware of a T7 with a watchdog (LabJack's constants).
_WATCHDOG_FIRMWARE: Final = 1.0016


class Device:
    """One device over one connection; calls wait for its answers. For one thread.

    Args:
        config: which device, and what of it is used.
    """

    def __init__(self, config: LabjackConfig) -> None:
        self._config = config
        self._connection = Connection(config.host, config.port)
        self._outputs = lj.bits(config.outputs)
        self._own = self._outputs | lj.bits(config.inputs)
        self._volts = [
            lj.dac(int(name[3:])) if (number := tick_of(name)) is None else lj.tdac(number)
            for name in config.analog_outputs
        ]
        self._put_volts: list[float | None] = [None] * len(self._volts)  # as confirmed last
        self._scan: tuple[Register, ...] = ()
        self._scan_packet = packet(lj.DIO_STATE)
        self._counters: set[int] = set()
        self.call_time = CallTime(CALL_S)

    def __str__(self) -> str:
        return self._connection.where

    @property
    def resting_lines(self) -> int:
        """The digital outputs at rest, one bit each."""
        return lj.bits(self._config.high_at_rest)

    def open(self) -> str:
        """Connect, bring the outputs to rest, set up the watchdog; return what device it is.

        Raises:
            LinkError: it cannot be reached, or another program keeps its drives enabled.
            ProtocolError: it is another device than the rig file names.
            DeviceError: it refuses what the rig file asks for.
        """
        identity = self._connect()
        self._check_unused()
        self.rest()
        self._set_up_watchdog()
        return identity

    def open_anew(self) -> None:
        """Connect again after a failure, and bring the outputs to rest; what is scanned stays.

        Raises:
            LinkError: it cannot be reached within 0.2 s, or does not answer.
            ProtocolError: it is another device than the rig file names.
            DeviceError: it refuses.
        """
        self._connection.close()
        self._connect(ANEW_S, again=True)
        self.rest()

    def close(self) -> None:
        """Close the connection; the outputs keep their levels. Closing twice is silent."""
        self._connection.close()
        self._scan, self._scan_packet = (), packet(lj.DIO_STATE)
        self._counters.clear()
        self._put_volts = [None] * len(self._volts)

    def rescue(self) -> None:
        """Bring the outputs to rest over a connection of its own; for a device not open.

        Raises:
            LinkError: it cannot be reached.
            ProtocolError: it is another device than the rig file names.
            DeviceError: it does not take it.
        """
        try:
            self._connect(again=True)
            self.rest()
        finally:
            self.close()

    def rest(self) -> None:
        """Bring the digital outputs to rest, then the analogue ones."""
        lines: list[Register | Write] = [Write(lj.DIO_INHIBIT, lj.ALL_LINES & ~self._own)]
        if self._config.product == "T4":  # whose lines may be analogue inputs
            lines.append(Write(lj.DIO_ANALOG_ENABLE, 0))
        state = Write(lj.DIO_STATE, self.resting_lines)
        # The state once more: a line that has become an output takes it only now.
        self._ask(packet(*lines, state, Write(lj.DIO_DIRECTION, self._outputs), state))
        self.put([0.0] * len(self._volts), self.resting_lines, again=True)

    def put(
        self, volts: Sequence[float], lines: int, *, feed: bool = False, again: bool = False
    ) -> int:
        """Set the digital outputs, then the analogue outputs that change.

        Args:
            volts: of every analogue output.
            lines: the digital outputs, one bit each.
            feed: also feed the watchdog.
            again: also analogue outputs that have these volts already.

        Returns:
            The levels of all lines as they were before.
        """
        frames: list[Register | Write] = [
            lj.DIO_STATE,
            Write(lj.DIO_INHIBIT, lj.ALL_LINES & ~self._outputs),
            Write(lj.DIO_STATE, lines),
        ]
        for number, value in enumerate(volts):
            if again or value != self._put_volts[number]:
                self._put_volts[number] = None
                frames.append(Write(self._volts[number], value))
        if feed:
            frames.append(Write(lj.WATCHDOG_CLEAR, _KEY))
        (levels,) = self._ask(packet(*frames))
        self._put_volts = list(volts)
        return int(levels)

    def levels(self) -> int:
        """Return the levels of all lines, one bit each."""
        return int(self._ask(packet(lj.DIO_STATE))[0])

    def use_volts(self, number: int) -> None:
        """Measure this analogue input, of +-10 V, in every scan from now on."""
        config = self._config
        frames = [Write(lj.ain_resolution(number), config.resolution)]
        if config.product == "T7":  # a T4 has one range and no differential inputs
            negative = number + 1 if number in config.differential else lj.SINGLE_ENDED
            frames += [Write(lj.ain_range(number), 10.0), Write(lj.ain_negative(number), negative)]
        self._ask(packet(*frames))
        self._scan_also(lj.ain(number))

    def use_counter(self, line: int) -> None:
        """Count at this line from now on, from 0: an encoder, or edges."""
        if line in self._counters:
            return
        edges = line in self._config.edge_counters
        lines = (line,) if edges else (line, line + 1)
        index = lj.INTERRUPT_COUNTER if edges else lj.QUADRATURE
        self._ask(
            packet(
                *(Write(lj.feature_enable(each), 0) for each in lines),
                *(Write(lj.feature_index(each), index) for each in lines),
                *(Write(lj.feature_enable(each), 1) for each in lines),
            )
        )
        self._counters.add(line)
        self._scan_also(lj.counted(line))

    def scan(self) -> tuple[int, tuple[float, ...]]:
        """Return the levels of all lines, and the counts and volts in use in their order.

        Raises:
            DeviceError: an analogue input gives what it cannot convert.
        """
        levels, *values = self._ask(self._scan_packet)
        for register, value in zip(self._scan, values, strict=True):
            if register.kind == "f" and not (math.isfinite(value) and abs(value) < _MOST_V):
                raise DeviceError(
                    f"{self}: {register.name} reads {value:g} V; no input converts that",
                    hint="the device reports a failed conversion: switch it off and on",
                )
        return int(levels), tuple(values)

    @property
    def scanned(self) -> tuple[Register, ...]:
        """What :meth:`scan` returns, in this order."""
        return self._scan

    def _scan_also(self, register: Register) -> None:
        """Take this in, too; counts first, which take no time to convert."""
        scan = sorted({*self._scan, register}, key=lambda item: (item.kind == "f", item.address))
        self._scan = tuple(scan)
        self._scan_packet = packet(lj.DIO_STATE, *scan)

    def _ask(self, asked: Packet) -> tuple[float, ...]:
        return self._connection.ask(asked, self.call_time.until_s)

    def _connect(self, within_s: float = OPEN_S, *, again: bool = False) -> str:
        """Connect, and return what device it is."""
        try:
            self._connection.open(within_s, again=again)
            return self._check_product()
        except LinkError as error:
            raise LinkError(
                error.message,
                hint="check its address, power and cable; it takes two connections at once, and "
                "rigd needs both: close Kipling and other programs",
            ) from error

    def _check_product(self) -> str:
        config = self._config
        asked = packet(lj.PRODUCT_ID, lj.FIRMWARE_VERSION, lj.SERIAL_NUMBER)
        number, firmware, serial = self._ask(asked)
        name = f"T{number:g}"
        if number != config.facts.number:
            raise ProtocolError(
                f"{self} is a {name}; the rig file has a {config.product}",
                hint="correct `host` or `product` of the link",
            )
        if config.serial is not None and serial != config.serial:
            raise ProtocolError(
                f"{self} has the serial number {serial:.0f}; the rig file has {config.serial}",
                hint="correct `host` or `serial` of the link",
            )
        old = config.product == "T7" and firmware < _WATCHDOG_FIRMWARE - 1e-6
        if config.watchdog is not None and old:
            raise DeviceError(
                f"{self} has firmware {firmware:.4f}, which has no watchdog; expected "
                f"{_WATCHDOG_FIRMWARE} at least",
                hint="update its firmware with LabJack's Kipling",
            )
        return f"LabJack {name}, serial number {serial:.0f}, firmware {firmware:.4f}"

    def _check_unused(self) -> None:
        """Wait until nothing keeps the guard up, as the watchdog of a killed program does.

        Raises:
            LinkError: another program feeds it.
        """
        guard, guard_s = self._config.guard, self._config.guard_s
        if guard is None or guard_s is None:
            return
        up_at = getattr(guard, "active", "high") == "high"
        wired = 1 << guard.output
        for _ in looks(guard_s):
            levels, directions = self._ask(packet(lj.DIO_STATE, lj.DIO_DIRECTION))
            driven = int(directions) & wired
            if not driven or bool(int(levels) >> guard.input & 1) != up_at:
                return
            time.sleep(_LOOK_S)
        raise LinkError(
            f"the drives on {self} are kept enabled: another program feeds the one-shot or "
            "watchdog, or it no longer falls by itself",
            hint="end that run; if there is none, check the wire of the guard",
        )

    def _set_up_watchdog(self) -> None:
        """Let the watchdog bring the outputs to rest, whenever it is not fed.

        The device keeps this in its flash memory, which wears: what stands there is not written
        again, and the watchdog stays on when the run is over.
        """
        watchdog = self._config.watchdog
        if watchdog is None:
            if self._ask(packet(lj.WATCHDOG_ENABLE))[0]:
                raise DeviceError(
                    f"the watchdog of {self} is on, and the rig file has none: it would act "
                    "during a run",
                    hint="add `watchdog` to the options of the link, or write 0 to "
                    "WATCHDOG_ENABLE_DEFAULT with LabJack's Kipling",
                )
            return
        wanted = self._watchdog_writes(watchdog)
        found = self._ask(packet(lj.WATCHDOG_ENABLE, *(item.register for item in wanted)))
        if found == (1, *(item.value for item in wanted)):
            return
        off, on = Write(lj.WATCHDOG_ENABLE, 0), Write(lj.WATCHDOG_ENABLE, 1)
        self._ask(packet(off, *wanted, on))

    def _watchdog_writes(self, watchdog: LabjackWatchdogOptions) -> list[Write]:
        guarded = [int(name[3:]) for name in self._config.analog_outputs if tick_of(name) is None]
        return [
            Write(lj.WATCHDOG_ADVANCED, 0),
            Write(lj.WATCHDOG_TIMEOUT_S, round(watchdog.timeout)),
            Write(lj.WATCHDOG_STARTUP_DELAY_S, round(watchdog.timeout)),
            Write(lj.WATCHDOG_STRICT, 1),
            Write(lj.WATCHDOG_KEY, _KEY),
            Write(lj.WATCHDOG_RESET, 0),
            Write(lj.WATCHDOG_DIO, 1),
            Write(lj.WATCHDOG_DIO_STATE, self.resting_lines),
            Write(lj.WATCHDOG_DIO_DIRECTION, self._outputs),
            Write(lj.WATCHDOG_DIO_INHIBIT, lj.ALL_LINES & ~self._outputs),
            *(Write(lj.watchdog_dac_enable(each), float(each in guarded)) for each in (0, 1)),
            *(Write(lj.watchdog_dac(each), 0.0) for each in (0, 1)),
        ]
