"""Reads and sets an instrument by a class of PyMeasure, in a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import math
from typing import Any, ClassVar, Final

from rigd.model.machine.extras import is_installed, missing
from rigd.sdk import (
    DeviceError,
    DriverConfig,
    LinkError,
    ProtocolError,
)
from rigd_drivers.instruments.polling import PolledInstrument
from rigd_drivers.instruments.pymeasure_bridge.config import (
    EXTRA,
    AttributeChannel,
    AttributeState,
    PymeasureConfig,
    class_name,
    number_of,
    steps,
    value_of,
)
from rigd_drivers.instruments.pymeasure_bridge.process import OPEN_S, Gone, NoAnswer, Process
from rigd_drivers.instruments.scpi.replies import LARGEST

#: So long an opening that failed waits for its process, in s: the daemon waits 2 s in all.
_FAILED_S: Final = 1.0
#: How much longer than its answers a call of PyMeasure may take, in s.
_MARGIN_S: Final = 1.0
_HINT: Final = "check that it is on, its cable, `address`, `connection` and `visa_library`"


class Pymeasure(PolledInstrument[PymeasureConfig]):
    """Reads channels and takes setpoints by attributes of a class of PyMeasure.

    Safe is what `safe` makes of it, once `state` shows it; an instrument without setpoints is
    always safe. It has no watchdog: a rig that sets something needs a waiver. If the process of the
    daemon is killed, that of the instrument makes it safe and ends.
    """

    Config: ClassVar[type[DriverConfig]] = PymeasureConfig
    title: ClassVar[str] = "instrument of PyMeasure: attributes of its class"
    unshared: ClassVar[tuple[str, ...]] = ("address",)

    def __init__(self, config: PymeasureConfig, link: None) -> None:
        where = f"{class_name(config.instrument)} at {config.address}"
        super().__init__(config, where, contextlib.nullcontext())
        self._call_s = self.longest_s(config)
        self._lock = asyncio.Lock()  # one question at a time
        self._process: Process | None = None

    @classmethod
    def longest_s(cls, config: PymeasureConfig) -> float:
        """See :class:`PolledInstrument`: PyMeasure may ask the instrument twice in a call."""
        return 2 * config.timeout + _MARGIN_S

    async def open(self) -> None:
        """Start the process, open the instrument, do `start`, and read the first channel.

        Raises:
            LinkError: the instrument cannot be opened, or does not answer.
            ProtocolError: it is not the instrument of `model`, or the channel is no number.
            DeviceError: PyMeasure is not installed, or refuses; or its queue has an error.
        """
        if not is_installed(EXTRA):
            raise DeviceError(missing(f"the instrument {self._where}", EXTRA))
        if self._process is not None:
            raise LinkError(f"{self._where} is open already", hint="close it first")
        process = self._new_process()
        try:
            await self._begin(process)
            self._process = process
            await self._done("it is opened", "start")
            self.identity = await self._identity(self._where)
            if not isinstance(row := await self._row(), tuple):
                raise row
            await self._raise_errors("it is opened")
        except BaseException:  # also when cancelled: nothing may stay open, nor on by `start`
            self._process = None
            await process.end(_FAILED_S)
            raise

    async def make_safe(self) -> None:
        """Do `safe` once the question that is open has ended; then check that `state` shows it.

        If the connection is gone, another is tried once.

        Raises:
            DeviceError: it does not show that it is safe.
            LinkError: it cannot be reached, or does not answer.
        """
        self._armed = False
        if self._process is None or self.config.state is None:
            return
        try:
            await self._done("it is made safe", "safe")
        except (LinkError, DeviceError) as error:
            await self._again(isinstance(error, Gone))
            await self._done("it is made safe", "safe")
        await self._check_safe()

    async def rescue(self) -> None:
        """Do `safe` before anything is read, then look at `state`; see :class:`SlowDriver`."""
        self._process = self._new_process(acted=True)
        try:
            await self._begin(self._process)
            await self.make_safe()
        finally:
            await self.close()

    async def close(self) -> None:
        """End the process, which closes the instrument; closing twice is silent."""
        self._armed = False  # the next open() arms nothing
        process, self._process = self._process, None
        if process is not None:
            await process.end()

    def _new_process(self, *, acted: bool = False) -> Process:
        config = self.config
        job = {
            "instrument": config.instrument,
            "address": config.address,
            "visa_library": config.visa_library,
            "connection": {name: value_of(text) for name, text in config.connection.items()},
            "timeout_ms": round(config.timeout * 1e3),
            "start": steps(config.start),
            "safe": steps(config.safe),
            "acted": acted,
        }
        return Process(job, self._where)

    async def _begin(self, process: Process) -> None:
        """Start the process and have it open the instrument."""
        await process.start()
        try:
            await process.ask(OPEN_S, do="open")
        except Gone:
            raise
        except (LinkError, DeviceError) as error:
            raise LinkError(
                f"{self._where} cannot be opened: {error.message}", hint=_HINT
            ) from error

    async def _again(self, gone: bool) -> None:
        """Open the instrument anew, in a new process if its own is gone."""
        async with self._lock:
            if self._process is None:
                return
            if not gone:
                await self._process.ask(self._call_s, do="open")
                return
            self._process = self._new_process(acted=True)
            await self._begin(self._process)

    def _question(self, item: AttributeChannel | AttributeState) -> str:
        return item.read

    def _answer(self, text: str) -> tuple[Any, str]:
        return value_of(text), text

    def _said(self, question: str, found: Any) -> str:
        return f"has {question} = {_shown(found)}"

    async def _set(self, name: str, value: float) -> str:
        item = self.config.setpoints[name]
        number = number_of(item, value)
        await self._done(f"{name} is set", "steps", steps=[(item.write, number)])
        return f"{item.write} = {number!r}"

    async def _switch_on(self) -> None:
        await self._done("it is armed", "steps", steps=steps(self.config.arm))

    async def _number(self, path: str) -> float | LinkError | ProtocolError:
        """See :class:`PolledInstrument`; raises Gone if the process has ended."""
        try:
            found = await self._ask("read", path=path)
        except Gone:
            raise
        except NoAnswer:
            return LinkError(f"{self._where} does not answer when {path} is read", hint=_HINT)
        except LinkError as error:
            return LinkError(f"{self._where}: {path} cannot be read: {error.message}", hint=_HINT)
        except DeviceError as error:
            return ProtocolError(
                f"{self._where}: {path} cannot be read: {error.message}",
                hint="compare the class with the manual of the instrument",
            )
        if not _is_number(found):
            return ProtocolError(
                f"{self._where} has {path} = {_shown(found)}, which is no number",
                hint="choose an attribute with one number, and check that the class fits",
            )
        return math.nan if not abs(found) < LARGEST else float(found)

    async def _raise_errors(self, when: str) -> None:
        """Raise what stands in the error queue."""
        if self.config.errors is None:
            return
        found = await self._done(when, "call", path=self.config.errors)
        if found is not None:
            raise DeviceError(
                f"{self._where} reports {_shown(found)} when {when}",
                hint="look the error up in its manual",
            )

    async def _get(self, path: str) -> Any:
        """Return the value of an attribute.

        Raises:
            LinkError: there is none in time, or the connection is lost.
            DeviceError: PyMeasure cannot read it.
        """
        return await self._done(f"{path} is read", "read", path=path)

    async def _done(self, when: str, do: str, **request: Any) -> Any:
        """Ask the process; an error tells ``when`` it came."""
        try:
            return await self._ask(do, **request)
        except Gone:
            raise
        except NoAnswer as error:
            raise LinkError(
                f"{self._where} does not answer within {self.config.timeout:g} s when {when}",
                hint=_HINT,
            ) from error
        except LinkError as error:
            raise LinkError(
                f"{self._where} is lost when {when}: {error.message}", hint=_HINT
            ) from error
        except DeviceError as error:
            asked = "".join(f", {path} = {value!r}" for path, value in request.get("steps", ()))
            raise DeviceError(
                f"{self._where}: PyMeasure refuses when {when}{asked}: {error.message}",
                hint="compare the value and the class with the manual of the instrument",
            ) from error

    async def _ask(self, do: str, **request: Any) -> Any:
        async with self._lock:
            if self._process is None:
                raise LinkError(f"{self._where} is not open")
            limit_s = OPEN_S if do == "start" else self._call_s
            return await self._process.ask(limit_s, do=do, **request)


def _is_number(found: Any) -> bool:
    return isinstance(found, (bool, int, float))


def _shown(found: Any) -> str:
    """Return a value as a message shows it; of a list its type and text."""
    return f"{found[1]} ({found[0]})" if isinstance(found, list) else repr(found)
