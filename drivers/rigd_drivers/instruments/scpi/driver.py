"""Asks an instrument with SCPI at its own pace, and sets what the rig file permits."""

from __future__ import annotations

import asyncio
from typing import Any, ClassVar, Final

from rigd.sdk import (
    DeviceError,
    DriverConfig,
    LinkError,
    ProtocolError,
)
from rigd.sdk.port import LinePort
from rigd_drivers.instruments.lines.outputs import LineState
from rigd_drivers.instruments.polling import PolledInstrument
from rigd_drivers.instruments.scpi.config import ScpiChannel, ScpiConfig
from rigd_drivers.instruments.scpi.replies import Entry, read_entry, read_number

#: How long an answer that did not come in time is waited for, in s, before it counts as lost.
LATE_S: Final = 0.3
#: Pause between two commands of `start`, in s: instruments with little memory lose the second.
_PAUSE_S: Final = 0.05
#: An answer to an earlier session may still come, if nothing has come for less than this, in s.
QUIET_S: Final = 0.1
#: Most entries of the error queue that are read at once; SCPI queues have from 2 to 30.
ENTRIES: Final = 16


class Scpi(PolledInstrument[ScpiConfig]):
    """Reads channels and takes setpoints of an instrument described as data.

    Safe is what the commands of `safe` make of it, once `state` shows it; an instrument without
    setpoints is always safe. It has no watchdog: a rig that sets something needs a waiver.
    """

    Config: ClassVar[type[DriverConfig]] = ScpiConfig
    title: ClassVar[str] = "instrument with SCPI: questions, setpoints, error queue"
    unshared: ClassVar[tuple[str, ...]] = ("port",)

    def __init__(self, config: ScpiConfig, link: None) -> None:
        super().__init__(config, config.port, asyncio.Lock())
        self._safe_by = ", ".join(config.safe)
        self._port = LinePort(config, late_s=LATE_S)
        self._is_open = False

    @classmethod
    def longest_s(cls, config: ScpiConfig) -> float:
        """See :class:`PolledInstrument`: it is asked twice, and a late answer waited for."""
        return 2 * (config.timeout + LATE_S)

    async def open(self) -> None:
        """Open the port, send `start`, and ask for the identity and the error queue.

        Raises:
            LinkError: the port cannot be opened, or nothing answers.
            ProtocolError: it is not the instrument of `model`.
            DeviceError: its error queue is not empty after `start`.

        """
        await self._port.open()
        try:
            for command in self.config.start:
                self._port.send(self.config.line(command))
                await asyncio.sleep(_PAUSE_S)
            await self._port.quiet(QUIET_S, timeout_s=self.config.timeout)
            self.identity = await self._identity(f"instrument at {self._where}")
            await self._raise_errors("it is opened")
        except BaseException:  # also when cancelled: nothing may stay open
            self._port.close()
            raise
        self._is_open = True

    async def make_safe(self) -> None:
        """Send `safe` at once, also while another answer is due; then check that `state` shows it.

        If the connection is gone, another is tried once.

        Raises:
            DeviceError: it does not show that it is safe.
            LinkError, ProtocolError: it cannot be reached, or does not answer.

        """
        self._armed = False
        if not self._is_open or self.config.state is None:
            return
        try:
            self._send_safe()
        except (LinkError, DeviceError):
            self._port.close()
            await self._port.open(again=True)
            self._send_safe()
        async with self._sequence:
            await self._check_safe()

    async def rescue(self) -> None:
        """Send `safe` over a new connection before anything is asked; see :class:`SlowDriver`."""
        await self._port.open(again=True)
        try:
            self._send_safe()
            await self._port.quiet(QUIET_S, timeout_s=self.config.timeout)
            try:
                await self._check_safe()
            except DeviceError:  # or an answer to the process that was killed
                await self._check_safe()
        finally:
            self._port.close()

    async def close(self) -> None:
        """Close the port; closing twice is silent."""
        self._is_open = self._armed = False  # the next open() arms nothing
        self._port.close()

    def _send_safe(self) -> None:
        for command in self.config.safe:
            self._port.send(self.config.line(command))

    def _question(self, item: ScpiChannel | LineState) -> str:
        return item.ask

    def _answer(self, text: str) -> tuple[str, str]:
        return text.strip(), repr(text)

    def _said(self, question: str, found: Any) -> str:
        return f"answers {found!r} to {question!r}"

    async def _number(self, question: str) -> float | LinkError | ProtocolError:
        answer = await self._ask(question)
        if answer is None:
            return self._silent(question)
        found = read_number(answer)
        if found is None:
            return ProtocolError(
                f"{self._where} {self._said(question, answer)}, which is no number",
                hint="compare the question with its manual",
            )
        return found

    async def _set(self, name: str, value: float) -> str:
        line = self.config.setpoints[name].line(name, value)
        self._port.send(line + self.config.line(""))
        return repr(line)

    async def _switch_on(self) -> None:
        for command in self.config.arm:
            self._port.send(self.config.line(command))

    async def _raise_errors(self, when: str) -> None:
        """Raise what stands in the error queue, all of it."""
        if self.config.errors is None:
            return
        if self.config.state is not None and self._port.is_doubtful:
            await self._get(self.config.state.ask)  # an entry can be read only once
        found: list[Entry] = []
        for _ in range(ENTRIES):
            answer = await self._get(self.config.errors)
            entry = read_entry(answer)
            if entry is None:
                raise ProtocolError(
                    f"{self.config.port} answers {answer!r} to {self.config.errors!r}",
                    hint="write `errors` as its manual has it, or `errors: null` without a queue",
                )
            if not entry.code:
                break
            found.append(entry)
        if found:
            raise DeviceError(
                f"{self.config.port} reports {'; '.join(map(str, found))} when {when}",
                hint="look the error up in its manual",
            )

    async def _get(self, question: str) -> str:
        """Return the answer to ``question``, without blanks around it.

        Raises:
            LinkError: there is none in time.

        """
        answer = await self._ask(question)
        if answer is None:
            raise self._silent(question)
        return answer

    def _silent(self, question: str) -> LinkError:
        return LinkError(
            f"{self._where} does not answer {question!r} within {self.config.timeout:g} s",
            hint="check that it is on, its cable, its baud rate, and `end`",
        )

    async def _ask(self, question: str) -> str | None:
        asked = self.config.line(question)
        echo = asked.strip()

        def take(line: bytes) -> bytes | None:
            return line if line.strip() and line.strip() != echo else None

        answer = await self._port.ask(asked, take, self.config.timeout)
        return None if answer is None else answer.decode("latin-1").strip()
