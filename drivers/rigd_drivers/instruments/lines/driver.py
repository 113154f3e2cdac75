"""Reads a device that sends lines of numbers, as the rig file describes them."""

from __future__ import annotations

import asyncio
import contextlib
from functools import partial
from typing import ClassVar, Final

from rigd.sdk import (
    Declaration,
    DeviceError,
    DriverConfig,
    EmitRow,
    LinkError,
    ProtocolError,
    SlowDriver,
)
from rigd.sdk.port import LinePort
from rigd_drivers.instruments.lines.config import LinesConfig
from rigd_drivers.instruments.lines.reader import LineReader, Reading
from rigd_drivers.instruments.lines.tally import LineStatus, Tally
from rigd_drivers.instruments.lines.text import encoded

#: How long an answer that did not come in time is waited for, in s, before it counts as lost.
LATE_S: Final = 0.7
#: Pause between two commands of `start`, in s: devices with little memory lose the second.
PAUSE_S: Final = 0.05
#: An answer to an earlier session may still come, if nothing has come for less than this, in s.
QUIET_S: Final = 0.1
#: The driver fails before the daemon calls the device silent, so that its message is seen; in s.
_MARGIN_S: Final = 1.0


class Lines(SlowDriver[LinesConfig, None]):
    """Reads channels from lines; the device takes no setpoints, so it is always safe.

    A line that is not as described is counted in the status word and never becomes a row; without
    a readable line for ``silence`` the driver fails, and names the last line with what is wrong.
    """

    Config: ClassVar[type[DriverConfig]] = LinesConfig
    title: ClassVar[str] = "device that sends lines of numbers, or answers a question"
    unshared: ClassVar[tuple[str, ...]] = ("port",)

    def __init__(self, config: LinesConfig, link: None) -> None:
        super().__init__(config, link)
        self._port = LinePort(config, max_line=config.longest, late_s=LATE_S)
        self._tally = Tally(config)
        self._ask = None if config.ask is None else encoded(config.ask)
        self._heard_s = 0.0  # when the last readable line came, in s of the loop
        self._received = 0  # bytes that had come by then
        self._late = 0  # answers that had come too late by then
        self._echoed = False  # a question came back since then

    @classmethod
    def declare(cls, config: LinesConfig) -> Declaration:
        """Return the channels of the rig file."""
        return Declaration(
            channels=tuple(item.channel(name) for name, item in config.channels.items()),
            plain_rows=True,
            has_status=True,
            status_bits={(bit.name or "").lower(): bit.value for bit in LineStatus},
            silent_s=config.silence_s + 2 * (config.timeout + LATE_S) + _MARGIN_S,
        )

    async def open(self) -> None:
        """Open the port, send `start`, and wait for the first readable line.

        Raises:
            LinkError: the port cannot be opened, or nothing comes.
            ProtocolError: no line is as described; names the last one.
            DeviceError: the port is gone.

        """
        await self._port.open()
        try:
            self._port.skip()  # the begin of a line that is on its way was not seen
            for command in self.config.start:
                self._port.send(encoded(command))
                await asyncio.sleep(PAUSE_S)
            if self._ask is not None:
                await self._port.quiet(QUIET_S, timeout_s=self.config.timeout)
            self.identity = await self._identity()
            self._tally = Tally(self.config)
            self._heard_s = asyncio.get_running_loop().time()
            await self._next()
        except BaseException:  # also when cancelled: nothing may stay open
            await self.close()
            raise

    async def run(self, emit: EmitRow) -> None:
        """Emit a row for each line, or each answer.

        Raises:
            DeviceError: the port is gone.
            LinkError: nothing comes any more.
            ProtocolError: no line is as described any more; names the last one.

        """
        loop = asyncio.get_running_loop()
        self._heard_s = due = loop.time()
        self._late = self._port.late
        if self._ask is None:
            self._port.skip()  # what came since it was opened is old: other devices took longer
            self._received = self._port.received
        while True:
            emit(self._tally.row(await self._next(), self._port.overlong))
            if self._ask is not None:
                due = max(due + self.config.period, loop.time())
                await asyncio.sleep(due - loop.time())

    async def close(self) -> None:
        """Send `stop`, if the port is still there, and close it; closing twice is silent."""
        with contextlib.suppress(LinkError, DeviceError):  # not open, or gone
            for command in self.config.stop:
                self._port.send(encoded(command))
        self._port.close()

    async def _identity(self) -> str:
        question = self.config.identify
        if question is None:
            return f"lines at {self.config.port}"
        asked = encoded(question)
        take = partial(LineReader(self.config).identity, asked)
        answer = await self._port.ask(asked, take, self.config.timeout)
        if answer is None:
            raise LinkError(
                f"{self.config.port} does not answer {asked!r} within {self.config.timeout:g} s",
                hint="check `identify`, the baud rate, and that the device is on",
            )
        return answer.decode("latin-1").strip()

    async def _next(self) -> Reading:
        """Return the next reading; lines that are lost or cannot be read are waited out."""
        loop = asyncio.get_running_loop()
        while True:
            silent_s = loop.time() - self._heard_s
            if silent_s >= self.config.silence_s:
                raise self._failure()
            found = await self._heard(self.config.silence_s - silent_s)
            if found is not None:
                self._heard_s = loop.time()
                self._received, self._late = self._port.received, self._port.late
                self._echoed = False
                return found

    async def _heard(self, timeout_s: float) -> Reading | None:
        if self._ask is not None:
            found = await self._port.ask(self._ask, self._take, self.config.timeout)
            if found is None:
                self._tally.unanswered()
                await asyncio.sleep(min(self.config.period, timeout_s))
            return found
        line = await self._port.line(timeout_s)
        return None if line is None else self._take(line)

    def _take(self, line: bytes) -> Reading | None:
        """Return the reading in ``line``; None for an echo, or if it cannot be read."""
        if self._ask is not None and line.strip() == self._ask.strip():
            self._echoed = True
            return None
        return self._tally.take(line)

    def _failure(self) -> DeviceError | LinkError | ProtocolError:
        config, port = self.config, self._port
        within = f"for {config.silence_s:g} s"
        if self._tally.last is not None:
            return ProtocolError(
                self._tally.wrong(config.port, within),
                hint="compare the line with `pattern` or `columns`; check baud rate and parity",
            )
        if port.late > self._late:
            return DeviceError(
                f"{config.port} answers later than {config.timeout:g} s: to which question is "
                "unknown",
                hint="raise `timeout`, or set a faster response at the device",
            )
        if self._echoed:
            return ProtocolError(
                f"{config.port} returns the question {self._ask!r} alone {within}",
                hint="check the end of `ask`, and that the cable joins no lines of this port",
            )
        if port.received > self._received:
            return ProtocolError(
                f"{config.port} sends bytes, but no line of at most {config.longest} "
                f"bytes {within}",
                hint="check baud rate and parity, that lines end with CR or LF, and `longest`",
            )
        asked = "" if self._ask is None else f" to {self._ask!r}"
        return LinkError(
            f"nothing comes from {config.port}{asked} {within}",
            hint="check that the device is on, its cable, its baud rate, and `ask` or `start`",
        )
