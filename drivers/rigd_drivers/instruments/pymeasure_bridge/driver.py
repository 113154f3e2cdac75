"""Reads and sets an instrument by a class of PyMeasure, in a process of its own."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence
from typing import Any, ClassVar, Final

from rigd.model.machine.extras import is_installed, missing
from rigd.sdk import (
    Declaration,
    DeviceError,
    DriverConfig,
    EmitRow,
    LinkError,
    ProtocolError,
    SlowDriver,
)
from rigd_drivers.instruments.polling import PolledStatus, in_range, poll
from rigd_drivers.instruments.pymeasure_bridge.config import (
    EXTRA,
    PymeasureConfig,
    class_name,
    number_of,
    steps,
    value_of,
)
from rigd_drivers.instruments.pymeasure_bridge.process import OPEN_S, Gone, NoAnswer, Process
from rigd_drivers.instruments.scpi.replies import LARGEST

#: Longest time until the output shows that it is on, in s.
READY_S: Final = 1.5
#: So long an opening that failed waits for its process, in s: the daemon waits 2 s in all.
_FAILED_S: Final = 1.0
#: Pause between two looks at `state`, in s.
PAUSE_S: Final = 0.05
#: The driver fails before the daemon calls the device silent, so that its message is seen; in s.
_MARGIN_S: Final = 1.0
_HINT: Final = "check that it is on, its cable, `address`, `connection` and `visa_library`"


class Pymeasure(SlowDriver[PymeasureConfig, None]):
    """Reads channels and takes setpoints by attributes of a class of PyMeasure.

    Safe is what `safe` makes of it, once `state` shows it; an instrument without setpoints is
    always safe. It has no watchdog: a rig that sets something needs a waiver. If the process of the
    daemon is killed, that of the instrument makes it safe and ends.
    """

    Config: ClassVar[type[DriverConfig]] = PymeasureConfig
    title: ClassVar[str] = "instrument of PyMeasure: attributes of its class"
    unshared: ClassVar[tuple[str, ...]] = ("address",)
    second_link: ClassVar[bool] = True

    def __init__(self, config: PymeasureConfig, link: None) -> None:
        super().__init__(config, link)
        self._where = f"{class_name(config.instrument)} at {config.address}"
        self._call_s = _call_s(config)
        self._lock = asyncio.Lock()  # one question at a time
        self._process: Process | None = None
        self._armed = False
        self._wrong: LinkError | ProtocolError | None = None  # why the last row is incomplete

    @classmethod
    def declare(cls, config: PymeasureConfig) -> Declaration:
        """Return the channels and setpoints of the rig file."""
        return Declaration(
            channels=config.measured(),
            setpoints=config.taken(),
            plain_rows=True,
            has_status=True,
            status_bits={(bit.name or "").lower(): bit.value for bit in PolledStatus},
            silent_s=config.silence_s + _call_s(config) + _MARGIN_S,
        )

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
            self.identity = await self._identity()
            if await self._row() is None:
                raise self._failure()
            await self._raise_errors("it is opened")
        except BaseException:  # also when cancelled: nothing may stay open, nor on by `start`
            self._process = None
            await process.end(_FAILED_S)
            raise

    async def run(self, emit: EmitRow) -> None:
        """Emit a row each period.

        Raises:
            DeviceError: its queue has an error, or its output went off by itself.
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
        """Write each setpoint, read it back if the rig file has `read`, and look for errors.

        Raises:
            DeviceError: PyMeasure or the instrument refuses it, or the instrument has another.
            LinkError, ProtocolError: it does not answer, or no number.
        """
        for (name, item), value in zip(self.config.setpoints.items(), setpoints, strict=True):
            number = number_of(item, value)
            await self._done(f"{name} is set", "steps", steps=[(item.write, number)])
            await self._raise_errors(f"{name} is set")
            if item.read is None:
                continue
            found = await self._read(item.read)
            if not _is_number(found) or item.apart(value, item.si(found)):
                raise DeviceError(
                    f"{self._where} was given {item.write} = {number!r}, and has {item.read} = "
                    f"{_shown(found)}",
                    hint="check `low`, `high` and `within`, and whether it is in local mode",
                )

    async def arm(self) -> None:
        """Do `arm`, and wait until `state` shows that the output is on.

        Raises:
            DeviceError: PyMeasure refuses, it reports an error, or its output stays off.
            LinkError: it does not answer.
        """
        state = self.config.state
        if state is None:
            return
        await self._done("it is armed", "steps", steps=steps(self.config.arm))
        await self._raise_errors("it is armed")
        loop = asyncio.get_running_loop()
        until_s = loop.time() + READY_S
        while (found := await self._read(state.read)) != value_of(state.ready):
            if loop.time() > until_s:
                raise DeviceError(
                    f"{self._where} has {state.read} = {_shown(found)}, expected "
                    f"{state.ready}: its output is not on",
                    hint="check `arm`, and what keeps its output off",
                )
            await asyncio.sleep(PAUSE_S)
        self._armed = True

    async def make_safe(self) -> None:
        """Do `safe` once the question that is open has ended; then check that `state` shows it.

        If the connection is gone, another is tried once.

        Raises:
            DeviceError: it does not show that it is safe.
            LinkError: it cannot be reached, or does not answer.
        """
        self._armed = False
        state = self.config.state
        if self._process is None or state is None:
            return
        try:
            await self._done("it is made safe", "safe")
        except (LinkError, DeviceError) as error:
            await self._again(isinstance(error, Gone))
            await self._done("it is made safe", "safe")
        found = await self._read(state.read)
        if found != value_of(state.safe):
            raise DeviceError(
                f"{self._where} has {state.read} = {_shown(found)} after `safe`, expected "
                f"{state.safe}"
            )

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

    async def _identity(self) -> str:
        if self.config.identify is None:
            return self._where
        found = await self._read(self.config.identify)
        identity = found if isinstance(found, str) else _shown(found)
        if self.config.model not in identity:
            raise ProtocolError(
                f"{self._where} is {identity!r}, which has no {self.config.model!r}",
                hint="check `address` and `model`",
            )
        return identity

    async def _take(self) -> tuple[float, ...] | None:
        """Return a row; None if it is not complete."""
        row = await self._row()
        if row is not None:
            await self._raise_errors("it measures")
            await self._check_output()
        return row

    async def _row(self) -> tuple[float, ...] | None:
        """Return values in SI and the status; None if one is missing or no number."""
        values, status = [], 0
        for name, item in self.config.channels.items():
            found = await self._reading(item.read)
            if found is None:
                return None
            value = item.si(found)
            if not in_range(value, item, name):
                self._wrong = ProtocolError(
                    f"{self._where} has {item.read} = {found!r}, beyond the range of {name}",
                    hint="compare the value with `unit`, `low` and `high` of the channel",
                )
                return None
            status |= PolledStatus.BEYOND if math.isnan(value) else 0
            values.append(value)
        return (*values, int(status))

    async def _reading(self, path: str) -> float | None:
        """Return the number in an attribute, NaN for one that means none; None: there is none."""
        try:
            found = await self._ask("read", path=path)
        except Gone:
            raise
        except NoAnswer:
            self._wrong = LinkError(
                f"{self._where} does not answer when {path} is read", hint=_HINT
            )
            return None
        except LinkError as error:
            self._wrong = LinkError(
                f"{self._where}: {path} cannot be read: {error.message}", hint=_HINT
            )
            return None
        except DeviceError as error:
            self._wrong = ProtocolError(
                f"{self._where}: {path} cannot be read: {error.message}",
                hint="compare the class with the manual of the instrument",
            )
            return None
        if not _is_number(found):
            self._wrong = ProtocolError(
                f"{self._where} has {path} = {_shown(found)}, which is no number",
                hint="choose an attribute with one number, and check that the class fits",
            )
            return None
        return math.nan if not abs(found) < LARGEST else float(found)

    async def _check_output(self) -> None:
        """Raise if the output has gone off by itself."""
        state = self.config.state
        if state is None or not self._armed:
            return
        found = await self._read(state.read)
        if found != value_of(state.ready) and self._armed:
            raise DeviceError(
                f"{self._where} has {state.read} = {_shown(found)} in mid-run: its output is not "
                "on any more",
                hint="look at its panel: a limit or its protection has switched it off",
            )

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

    async def _read(self, path: str) -> Any:
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

    def _failure(self) -> LinkError | ProtocolError:
        return self._wrong or LinkError(f"{self._where} gives no row", hint=_HINT)


def _call_s(config: PymeasureConfig) -> float:
    """Return after which time a call of PyMeasure hangs, in s: it asks the instrument twice."""
    return 2 * config.timeout + _MARGIN_S


def _is_number(found: Any) -> bool:
    return isinstance(found, (bool, int, float))


def _shown(found: Any) -> str:
    """Return a value as a message shows it; of a list its type and text."""
    return f"{found[1]} ({found[0]})" if isinstance(found, list) else repr(found)
