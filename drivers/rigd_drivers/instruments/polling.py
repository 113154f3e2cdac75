"""Asks an instrument for one row each period, sets what the rig file permits, and gives it up.

What all polled instruments have in common; :class:`PolledInstrument` lists what each has to add.
"""

from __future__ import annotations

import asyncio
import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from enum import IntFlag
from typing import TYPE_CHECKING, Any, ClassVar, Final, TypeVar

from rigd.sdk import (
    Declaration,
    DeviceError,
    DriverConfig,
    EmitRow,
    LinkError,
    ProtocolError,
    SlowDriver,
)
from rigd_drivers.wait import looks

if TYPE_CHECKING:
    from rigd_drivers.instruments.lines.config import LineChannel
    from rigd_drivers.instruments.lines.outputs import ReadBack

#: Time without a row after which the instrument is given up, in s, if it is not given: it has so
#: many chances to answer.
_LEAST_SILENCE_S: Final = 3.0
_CHANCES: Final = 3
#: Longest time until the output shows that it is on, in s.
READY_S: Final = 1.5
#: Pause between two looks at `state`, in s.
PAUSE_S: Final = 0.05
#: The driver fails before the daemon calls the device silent, so that its message is seen; in s.
_MARGIN_S: Final = 1.0


class PolledStatus(IntFlag):
    """The status word of a row."""

    BEYOND = 1  #: a value is beyond the instrument's range, and NaN
    INCOMPLETE = 2  #: since the row before, an answer did not come or could not be read


class PolledConfig(DriverConfig):
    """The options that the driver of a polled instrument needs, in the order of its own."""

    if TYPE_CHECKING:
        channels: Mapping[str, LineChannel]
        setpoints: Mapping[str, ReadBack]
        state: Any
        identify: str | None
        model: str
        period: float
        timeout: float
        silence: float | None

    @property
    def silence_s(self) -> float:
        """Longest time without a row, in s."""
        if self.silence is not None:
            return self.silence
        questions = len(self.channels) + 2
        return max(_LEAST_SILENCE_S, _CHANCES * (self.period + questions * self.timeout))


PolledConfigT = TypeVar("PolledConfigT", bound=PolledConfig)


class PolledInstrument(SlowDriver[PolledConfigT, None]):
    """Reads channels each period, and takes setpoints that it reads back.

    Args:
        config: its options.
        where: the instrument, for messages.
        sequence: keeps the questions of a row and those of setpoints apart, if they must be.
    """

    second_link: ClassVar[bool] = True

    def __init__(
        self, config: PolledConfigT, where: str, sequence: AbstractAsyncContextManager[Any]
    ) -> None:
        super().__init__(config, None)
        self._where = where
        self._sequence = sequence
        self._safe_by = "`safe`"  # what made it safe, for messages
        self._armed = False

    # -- what each instrument adds -------------------------------------------------------------

    @classmethod
    @abstractmethod
    def longest_s(cls, config: PolledConfigT) -> float:
        """Return how long a question takes at most that is not answered, in s."""

    @abstractmethod
    async def _get(self, question: str) -> Any:
        """Return the answer to ``question``; raises LinkError or DeviceError if there is none."""

    @abstractmethod
    async def _number(self, question: str) -> float | LinkError | ProtocolError:
        """Return the number that answers ``question``, NaN for one that means none; or why not."""

    @abstractmethod
    async def _set(self, name: str, value: float) -> str:
        """Set a setpoint to ``value``, in SI; return in words what was sent."""

    @abstractmethod
    async def _switch_on(self) -> None:
        """Do what `arm` has."""

    @abstractmethod
    async def _raise_errors(self, when: str) -> None:
        """Raise DeviceError if its error queue has an entry, which came ``when``."""

    @abstractmethod
    def _question(self, item: Any) -> str:
        """Return the question of a channel, or of `state`."""

    @abstractmethod
    def _answer(self, text: str) -> tuple[Any, str]:
        """Return the answer that ``text`` in the rig file means, and how a message shows it."""

    @abstractmethod
    def _said(self, question: str, found: Any) -> str:
        """Return in words that it gave this answer."""

    # -- what all do ---------------------------------------------------------------------------

    @classmethod
    def declare(cls, config: PolledConfigT) -> Declaration:
        """Return the channels and setpoints of the rig file."""
        return Declaration(
            channels=tuple(item.channel(name) for name, item in config.channels.items()),
            setpoints=tuple(item.channel(name) for name, item in config.setpoints.items()),
            plain_rows=True,
            has_status=True,
            status_bits={(bit.name or "").lower(): bit.value for bit in PolledStatus},
            silent_s=config.silence_s + cls.longest_s(config) + _MARGIN_S,
        )

    async def run(self, emit: EmitRow) -> None:
        """Emit a row each period, with :attr:`PolledStatus.INCOMPLETE` behind one that is missing.

        Raises:
            DeviceError: its error queue has an entry, or its output went off by itself.
            LinkError, ProtocolError: no complete row comes any more.

        """
        loop = asyncio.get_running_loop()
        heard_s = due = loop.time()
        skipped = False
        while True:
            row = await self._take()
            if isinstance(row, tuple):
                *values, status = row
                emit((*values, int(status) | (PolledStatus.INCOMPLETE if skipped else 0)))
                heard_s, skipped = loop.time(), False
            else:
                skipped = True
                if loop.time() - heard_s >= self.config.silence_s:
                    for_s = f"for {self.config.silence_s:g} s"
                    raise type(row)(f"{row.message}, {for_s}", hint=row.hint) from row
            due = max(due + self.config.period, loop.time())
            await asyncio.sleep(due - loop.time())

    async def write(self, setpoints: Sequence[float]) -> None:
        """Set each setpoint, read it back if the rig file has `read`, and look for errors.

        Raises:
            DeviceError: the instrument refuses a setpoint, or has taken another.
            LinkError, ProtocolError: it does not answer, or no number.

        """
        async with self._sequence:
            for (name, item), value in zip(self.config.setpoints.items(), setpoints, strict=True):
                given = await self._set(name, value)
                await self._raise_errors(f"{name} is set")
                if item.read is None:
                    continue
                found = await self._number(item.read)
                if isinstance(found, LinkError):
                    raise found
                if isinstance(found, ProtocolError) or item.apart(value, item.si(found)):
                    raise DeviceError(
                        f"{self._where} was given {given}, and {self._said(item.read, found)}",
                        hint="check `low`, `high` and `within`, and whether it is in local mode",
                    )

    async def arm(self) -> None:
        """Do `arm`, and wait until `state` shows that the output is on.

        Raises:
            DeviceError: it reports an error, or its output stays off.
            LinkError: it does not answer.

        """
        state = self.config.state
        if state is None:
            return
        async with self._sequence:
            await self._switch_on()
            await self._raise_errors("its output is switched on")
            question, found = self._question(state), None
            ready, shown = self._answer(state.ready)
            for _ in looks(READY_S):
                if (found := await self._get(question)) == ready:
                    self._armed = True
                    return
                await asyncio.sleep(PAUSE_S)
        raise DeviceError(
            f"{self._where} {self._said(question, found)}, expected {shown}: its output is not on",
            hint="check `arm`, and what keeps its output off",
        )

    async def _check_safe(self) -> None:
        """Raise if `state` does not show that it is safe."""
        state = self.config.state
        if state is None:
            return
        safe, shown = self._answer(state.safe)
        question = self._question(state)
        if (found := await self._get(question)) != safe:
            raise DeviceError(
                f"{self._where} {self._said(question, found)} after {self._safe_by}, expected "
                f"{shown}"
            )

    async def _check_output(self) -> None:
        """Raise if the output has gone off by itself."""
        state = self.config.state
        if state is None or not self._armed:
            return
        question = self._question(state)
        found = await self._get(question)
        if found != self._answer(state.ready)[0] and self._armed:
            raise DeviceError(
                f"{self._where} {self._said(question, found)} in mid-run: its output is not on any "
                "more",
                hint="look at its panel: a limit or its protection has switched it off",
            )

    async def _identity(self, unnamed: str) -> str:
        """Return how it identifies itself; ``unnamed`` if it is not asked."""
        question = self.config.identify
        if question is None:
            return unnamed
        identity = str(await self._get(question))
        if self.config.model not in identity:
            raise ProtocolError(
                f"{self._where} is {identity!r}, which has no {self.config.model!r}",
                hint="check its address and `model`",
            )
        return identity

    async def _take(self) -> tuple[float, ...] | LinkError | ProtocolError:
        """Return a row, behind which its queue and its output were looked at; or why not."""
        async with self._sequence:
            row = await self._row()
            if isinstance(row, tuple):
                await self._raise_errors("it measures")
                await self._check_output()
        return row

    async def _row(self) -> tuple[float, ...] | LinkError | ProtocolError:
        """Return values in SI and the status; or why one is missing or no number."""
        values, status = [], 0
        for name, item in self.config.channels.items():
            question = self._question(item)
            found = await self._number(question)
            if not isinstance(found, float):
                return found
            value, channel = item.si(found), item.channel(name)
            if not (math.isnan(value) or channel.low <= value <= channel.high):
                return ProtocolError(
                    f"{self._where} {self._said(question, found)}, beyond the range of {name}",
                    hint="compare the answer with `unit`, `low` and `high` of the channel",
                )
            status |= PolledStatus.BEYOND if math.isnan(value) else 0
            values.append(value)
        return (*values, int(status))
