"""Asks an instrument with SCPI at its own pace, and sets what the rig file permits."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
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
from rigd_drivers.instruments.polling import PolledStatus, in_range, poll
from rigd_drivers.instruments.scpi.config import ScpiConfig
from rigd_drivers.instruments.scpi.replies import Entry, read_entry, read_number

#: How long an answer that did not come in time is waited for, in s, before it counts as lost.
LATE_S: Final = 0.3
#: Pause between two commands of `start`, in s: instruments with little memory lose the second.
PAUSE_S: Final = 0.05
#: An answer to an earlier session may still come, if nothing has come for less than this, in s.
QUIET_S: Final = 0.1
#: Most entries of the error queue that are read at once; SCPI queues have from 2 to 30.
ENTRIES: Final = 16
#: Longest time until the output shows that it is on, in s.
READY_S: Final = 1.5
#: The driver fails before the daemon calls the device silent, so that its message is seen; in s.
_MARGIN_S: Final = 1.0


class Scpi(SlowDriver[ScpiConfig, None]):
    """Reads channels and takes setpoints of an instrument described as data.

    Safe is what the commands of `safe` make of it, once `state` shows it; an instrument without
    setpoints is always safe. It has no watchdog: a rig that sets something needs a waiver.
    """

    Config: ClassVar[type[DriverConfig]] = ScpiConfig
    title: ClassVar[str] = "instrument with SCPI: questions, setpoints, error queue"
    unshared: ClassVar[tuple[str, ...]] = ("port",)
    second_link: ClassVar[bool] = True

    def __init__(self, config: ScpiConfig, link: None) -> None:
        super().__init__(config, link)
        self._port = LinePort(config, late_s=LATE_S)
        self._lock = asyncio.Lock()  # keeps the questions of run() and of the setpoints apart
        self._is_open = self._armed = False
        self._wrong = ""  # why the last row is incomplete

    @classmethod
    def declare(cls, config: ScpiConfig) -> Declaration:
        """Return the channels and setpoints of the rig file."""
        return Declaration(
            channels=config.measured(),
            setpoints=config.taken(),
            plain_rows=True,
            has_status=True,
            status_bits={(bit.name or "").lower(): bit.value for bit in PolledStatus},
            silent_s=config.silence_s + 2 * (config.timeout + LATE_S) + _MARGIN_S,
        )

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
                await asyncio.sleep(PAUSE_S)
            await self._port.quiet(QUIET_S, timeout_s=self.config.timeout)
            self.identity = await self._identity()
            await self._raise_errors("it is opened")
        except BaseException:  # also when cancelled: nothing may stay open
            self._port.close()
            raise
        self._is_open = True

    async def run(self, emit: EmitRow) -> None:
        """Emit a row each period.

        Raises:
            DeviceError: its error queue has an entry, or its output went off by itself.
            LinkError, ProtocolError: no complete row comes any more.

        """
        await poll(
            self._take,
            emit,
            period_s=self.config.period,
            silence_s=self.config.silence_s,
            failure=self._failure,
        )

    async def write(self, setpoints: Sequence[float]) -> None:
        """Send each setpoint, read it back if the rig file has `read`, and look for errors.

        Raises:
            DeviceError: the instrument refuses a setpoint, or has taken another.
            LinkError, ProtocolError: it does not answer, or no number.

        """
        async with self._lock:
            for (name, item), value in zip(self.config.setpoints.items(), setpoints, strict=True):
                self._port.send(item.line(name, value) + self.config.line(""))
                await self._raise_errors(f"{name} is set")
                if item.read is None:
                    continue
                found = read_number(await self._answer(item.read))
                if found is None or item.apart(value, item.si(found)):
                    raise DeviceError(
                        f"{self.config.port} was given {item.line(name, value)!r}, and answers "
                        f"{found!r} to {item.read!r}",
                        hint="check `low`, `high` and `within`, and whether it is in local mode",
                    )

    async def arm(self) -> None:
        """Send `arm`, and wait until `state` shows that the output is on.

        Raises:
            DeviceError: it reports an error, or its output stays off.

        """
        state = self.config.state
        if state is None:
            return
        async with self._lock:
            for command in self.config.arm:
                self._port.send(self.config.line(command))
            await self._raise_errors("its output is switched on")
            until_s = asyncio.get_running_loop().time() + READY_S
            while (answer := await self._answer(state.ask)) != state.ready.strip():
                if asyncio.get_running_loop().time() > until_s:
                    raise DeviceError(
                        f"{self.config.port} answers {answer!r} to {state.ask!r}, expected "
                        f"{state.ready!r}: its output is not on",
                        hint="check `arm`, and what keeps its output off",
                    )
                await asyncio.sleep(PAUSE_S)
            self._armed = True

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
        async with self._lock:
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

    async def _check_safe(self) -> None:
        state = self.config.state
        if state is None:
            return
        answer = await self._answer(state.ask)
        if answer != state.safe.strip():
            raise DeviceError(
                f"{self.config.port} answers {answer!r} to {state.ask!r} after "
                f"{', '.join(self.config.safe)}, expected {state.safe!r}"
            )

    async def _check_output(self) -> None:
        """Raise if the output has gone off by itself."""
        state = self.config.state
        if state is None or not self._armed:
            return
        answer = await self._answer(state.ask)
        if answer != state.ready.strip() and self._armed:
            raise DeviceError(
                f"{self.config.port} answers {answer!r} to {state.ask!r} in mid-run: its output is "
                "not on any more",
                hint="look at its panel: a limit or its protection has switched it off",
            )

    async def _identity(self) -> str:
        question = self.config.identify
        if question is None:
            return f"instrument at {self.config.port}"
        identity = await self._answer(question)
        if self.config.model not in identity:
            raise ProtocolError(
                f"{self.config.port} is {identity!r}, which has no {self.config.model!r}",
                hint="check `port` and `model`",
            )
        return identity

    async def _take(self) -> tuple[float, ...] | None:
        """Return a row; None if it is not complete."""
        async with self._lock:
            row = await self._row()
            if row is not None:
                await self._raise_errors("it measures")
                await self._check_output()
        return row

    async def _row(self) -> tuple[float, ...] | None:
        """Return values in SI and the status; None if an answer is missing or no number."""
        values, status = [], 0
        for name, item in self.config.channels.items():
            answer = await self._ask(item.ask)
            if answer is None:
                self._wrong = ""
                return None
            found = read_number(answer)
            if found is None or not in_range(item.si(found), item, name):
                kind = "no number" if found is None else "beyond the range of the channel"
                self._wrong = f"answers {answer!r} to {item.ask!r}, which is {kind}"
                return None
            status |= PolledStatus.BEYOND if found != found else 0
            values.append(item.si(found))
        return (*values, int(status))

    async def _raise_errors(self, when: str) -> None:
        """Raise what stands in the error queue, all of it."""
        if self.config.errors is None:
            return
        if self.config.state is not None and self._port.is_doubtful:
            await self._answer(self.config.state.ask)  # an entry can be read only once
        found: list[Entry] = []
        for _ in range(ENTRIES):
            answer = await self._answer(self.config.errors)
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

    async def _answer(self, question: str) -> str:
        """Return the answer to ``question``, without blanks around it.

        Raises:
            LinkError: there is none in time.

        """
        answer = await self._ask(question)
        if answer is None:
            raise LinkError(
                f"{self.config.port} does not answer {question!r} within {self.config.timeout:g} s",
                hint="check that it is on, its cable, its baud rate, and `end`",
            )
        return answer

    async def _ask(self, question: str) -> str | None:
        asked = self.config.line(question)
        echo = asked.strip()

        def take(line: bytes) -> bytes | None:
            return line if line.strip() and line.strip() != echo else None

        answer = await self._port.ask(asked, take, self.config.timeout)
        return None if answer is None else answer.decode("latin-1").strip()

    def _failure(self) -> LinkError | ProtocolError:
        within = f"for {self.config.silence_s:g} s"
        if self._wrong:
            return ProtocolError(
                f"{self.config.port} {self._wrong}, {within}",
                hint="compare the answer with `unit`, `low` and `high` of the channel",
            )
        return LinkError(
            f"{self.config.port} does not answer its questions {within}",
            hint="check that it is on, its cable, its baud rate, and `end`",
        )
