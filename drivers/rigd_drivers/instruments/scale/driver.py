"""Reads the weight from a scale on a serial port."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable, Mapping
from enum import IntFlag
from typing import Annotated, ClassVar, Final, Literal, TypeVar

from annotated_types import Ge, Le
from pydantic import model_validator

from rigd.sdk import (
    Channel,
    Declaration,
    DeviceError,
    DriverConfig,
    EmitRow,
    In,
    LinkError,
    ProtocolError,
    Row,
    SlowDriver,
    wrong_entry,
)
from rigd.sdk.port import LinePort, Parity, PortConfig
from rigd_drivers.instruments.scale import and_d, identity
from rigd_drivers.instruments.scale.dialects import DIALECTS, DialectName
from rigd_drivers.instruments.scale.replies import UNITS, Done, Load, Reading, Refusal, UnitName
from rigd_drivers.wait import looks

T = TypeVar("T")

#: A scale answers within 0.1 s, one that filters or is busy within 0.7 s; 9600 baud needs 17 ms.
REPLY_S: Final = 0.8
#: Without one good reading for so long the scale is given up, in s. Below ``silent_s``, so that
#: the message contains what was received instead.
GIVE_UP_S: Final = 2.0
#: How long an action waits for the load to come to rest, in s; scales themselves give up after
#: 10 s to 40 s.
REST_S: Final = 10.0
#: How long the scale may take to carry out an action at rest, in s.
ACTION_S: Final = 3.0
#: A line that carries no byte for so long has fallen silent, in s: a stream of 5 lines a second
#: (A&D, the slowest) has not.
QUIET_S: Final = 0.3
#: What a person may ask of a scale.
ACTIONS: Final[Mapping[str, str]] = {
    "tare": "takes the load that rests on it as tare: it then shows zero",
    "zero": "sets the zero of the empty scale",
}
#: Lines in a row in another unit that are a change of unit and no damaged line.
UNIT_LINES: Final = 2


class ScaleStatus(IntFlag):
    """The status word of a row."""

    STABLE = 1
    OVERLOAD = 2
    UNDERLOAD = 4


_STATUS: Final = {
    Load.STABLE: ScaleStatus.STABLE,
    Load.DYNAMIC: ScaleStatus(0),
    Load.OVERLOAD: ScaleStatus.OVERLOAD,
    Load.UNDERLOAD: ScaleStatus.UNDERLOAD,
}


class ScaleConfig(PortConfig):
    """The serial port of the scale, its protocol, and the unit it must show."""

    dialect: DialectName
    """Protocol that is set in the menu of the scale."""
    unit: UnitName = "kg"
    """Unit the scale must show. In another one nothing is measured: lines carry their unit."""
    baud: Literal[600, 1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200] = 9600
    """Baud rate set in the menu of the scale (A&D: 2400 as delivered)."""
    parity: Parity = "none"
    """Parity set in the menu of the scale (A&D: even as delivered)."""
    data_bits: Literal[7, 8] = 8
    """Data bits set in the menu of the scale (A&D: 7 as delivered)."""
    interval: Annotated[float, In("s"), Ge(0.02), Le(1)] = 0.15
    """Time from one reading to the next; KERN KCP asks for more than 100 ms."""

    @model_validator(mode="after")
    def _interval_is_allowed(self) -> ScaleConfig:
        least = DIALECTS[self.dialect].min_interval_s
        if self.interval <= least > 0:
            raise wrong_entry(
                f"interval {self.interval:g} s: {self.dialect} needs more than {least:g} s",
                "interval",
            )
        return self


class MassRow(Row):
    """The mass, and :class:`ScaleStatus`."""

    mass: float
    status: int


class ForceRow(Row):
    """The force, of a scale that shows newtons, and :class:`ScaleStatus`."""

    force: float
    status: int


class SerialScale(SlowDriver[ScaleConfig, None]):
    """Polls a scale for its weight; always safe, because a scale moves nothing.

    A row is the mass in kg (``force`` in N if the scale shows newtons) and a status word: stable 1,
    overload 2, underload 4. Beyond its range the value is NaN, so that interlocks trip.
    """

    Config: ClassVar[type[DriverConfig]] = ScaleConfig
    title: ClassVar[str] = "scale on a serial or TCP port (MT-SICS, KERN KCP, A&D, SBI, Ohaus)"
    unshared: ClassVar[tuple[str, ...]] = ("port",)

    def __init__(self, config: ScaleConfig, link: None) -> None:
        super().__init__(config, link)
        self._dialect = DIALECTS[config.dialect]
        interval_s = self._dialect.min_interval_s
        self._port = LinePort(config, self_checking=True, min_interval_s=interval_s)
        self._one_at_a_time = asyncio.Lock()  # run and act share the line
        self._wrong_unit = 0  # lines in a row in another unit

    @classmethod
    def declare(cls, config: ScaleConfig) -> Declaration:
        """Return the mass or the force that the scale shows, tare and zero as actions."""
        row: type[Row]
        if config.unit == "N":
            row, shown = ForceRow, Channel("force", "N", "force shown by the scale")
        else:
            row, shown = MassRow, Channel("mass", "kg", "net mass shown by the scale")
        return Declaration(
            channels=(shown,),
            row=row,
            status_bits={(bit.name or "").lower(): bit.value for bit in ScaleStatus},
            actions=ACTIONS,
            silent_s=5.0,  # an action keeps the scale from answering for up to ACTION_S
        )

    async def open(self) -> None:
        """Open the port, end a stream left on, check the kind of the device and its unit.

        Raises:
            LinkError: the port cannot be opened, or nothing answers.
            ProtocolError: what answers is no scale of this dialect.
            DeviceError: it shows another unit than the rig file has.

        """
        config = self.config
        await self._port.open()
        try:
            await self._quieten()
            self.identity = await identity.ask(
                config.dialect, self._port.question, lambda: self._port.line(REPLY_S)
            )
            while self._converted(await self._patient_reading()) is None:
                pass  # a unit is wrong once it has been read twice
        except BaseException:
            self._port.close()
            raise

    async def run(self, emit: EmitRow) -> None:
        """Emit a row per reading, every ``interval``.

        Raises:
            DeviceError: it gives no weight any more, or shows another unit.

        """
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            row = self._converted(await self._patient_reading())
            if row is not None:
                emit(row)
            due = max(due + self.config.interval, loop.time())
            await asyncio.sleep(due - loop.time())

    async def act(self, action: str) -> str:
        """Tare or zero, once the load rests; return the answer of the scale.

        Raises:
            DeviceError: the load does not come to rest, or the scale refuses.
            ValueError: there is no such action.

        """
        if action not in ACTIONS:
            raise ValueError(f"a scale has no action {action!r}; it has {', '.join(ACTIONS)}")
        await self._rest(action)
        command, parse = self._dialect.actions[action]
        if parse is None:
            return await self._act_unconfirmed(action, command)
        answer: Done | Refusal | None = None
        async with self._one_at_a_time:
            try:
                answer = await self._order(command, parse, ACTION_S)
            finally:
                if answer is None:  # given up or cancelled: it must not tare some time later
                    self._end(self._dialect.cancel)
        if answer is None:
            raise DeviceError(
                f"the scale did not {action} within {ACTION_S:g} s",
                hint="keep the load at rest, away from draught and vibration",
            )
        if isinstance(answer, Refusal):
            raise _refused(action, answer)
        return answer.text or f"{action} done"

    async def close(self) -> None:
        """End a stream, if there is one, and close the port; a tare stays as it is."""
        self._end(self._dialect.quieten)
        self._port.close()

    def _end(self, command: bytes) -> None:
        """End what the scale does by ``command``, if it still answers."""
        with contextlib.suppress(LinkError, DeviceError):  # not open, or gone: nothing to end
            self._port.send(command)

    async def _quieten(self) -> None:
        """End a stream that the last session left on; the line is quiet afterwards."""
        for _ in range(2):  # the first may be taken for the rest of a line cut off
            await self._port.question(self._dialect.quieten)
            if await self._port.quiet(QUIET_S, timeout_s=1.5):
                return
        raise ProtocolError(
            f"the scale at {self.config.port} keeps sending after the command to stop",
            hint="set it to send on request only (menu: 'command mode', not 'stream' or "
            "'continuous'), and check that baud rate and parity are those of the rig file",
        )

    async def _patient_reading(self) -> Reading:
        """Return the next reading; single lines that are lost or damaged are asked for again."""
        loop = asyncio.get_running_loop()
        deadline = None
        port = self._port
        received, late, port.unusual = port.received, port.late, None
        while True:
            async with self._one_at_a_time:
                answer: Reading | Refusal | None = await self._exchange(
                    self._dialect.read, self._dialect.parse_reading, REPLY_S
                )
            if isinstance(answer, Reading):
                return answer
            if deadline is None:
                deadline = loop.time() + GIVE_UP_S
            elif loop.time() + REPLY_S > deadline:
                raise self._no_reading(
                    answer, heard=port.received > received, late=port.late > late
                )
            await asyncio.sleep(self.config.interval)

    def _no_reading(
        self, answer: Refusal | None, *, heard: bool, late: bool
    ) -> LinkError | ProtocolError | DeviceError:
        port, baud = self.config.port, self.config.baud
        if answer is not None:
            return DeviceError(
                f"the scale gives no weight: it answers {answer.code!r} ({answer.reason})",
                hint="look at its display: menu open, calibration, warming up?",
            )
        if late:
            return DeviceError(
                f"the scale answers later than {REPLY_S:g} s: to which question is unknown",
                hint="set a faster response or a weaker filter in its menu",
            )
        if self._port.unusual is not None:
            return ProtocolError(
                f"{port} answers {self._port.unusual[:40]!r} to {self._dialect.read!r}, which is "
                f"no weight in {self._dialect.title}",
                hint=f"check that the scale is set to this protocol and to {baud} baud",
            )
        if heard:
            return ProtocolError(
                f"{port} sends bytes, but no line that can be read at {baud} baud",
                hint="check baud rate, parity and data bits in the menu of the scale",
            )
        return LinkError(
            f"nothing answers at {port}, {baud} baud",
            hint="is the scale on, its cable in, and its interface set to this baud rate?",
        )

    def _converted(self, reading: Reading) -> MassRow | ForceRow | None:
        """Return the row; None if the unit differs, because the line may be damaged."""
        if reading.unit and reading.unit != self.config.unit:
            self._wrong_unit += 1
            if self._wrong_unit < UNIT_LINES:
                return None
            shown, wanted = reading.unit, self.config.unit
            change = (
                f"press UNIT at the scale until it shows {wanted}, or write "
                f"'unit: {shown}' in the rig file"
                if shown in UNITS and shown not in ("mg", "t")
                else f"press UNIT at the scale until it shows {wanted}"
            )
            raise DeviceError(f"the scale shows {shown}, the rig expects {wanted}", hint=change)
        self._wrong_unit = 0
        value = reading.value * UNITS[self.config.unit]
        status = int(_STATUS[reading.load])
        if self.config.unit == "N":
            return ForceRow.of(force=value, status=status)
        return MassRow.of(mass=value, status=status)

    async def _rest(self, action: str) -> Reading:
        """Return the first stable reading; rows go on being taken meanwhile."""
        load = Load.DYNAMIC
        for _ in looks(REST_S):
            reading = await self._patient_reading()
            if (load := reading.load) is Load.STABLE:
                return reading
            await asyncio.sleep(self.config.interval)
        raise DeviceError(
            f"cannot {action}: the load did not come to rest within {REST_S:g} s ({load.value})",
            hint="keep it still, away from draught and vibration, and within the range",
        )

    async def _act_unconfirmed(self, action: str, command: bytes) -> str:
        """Do an action of a dialect that need not confirm: it is done once zero is shown."""
        async with self._one_at_a_time:
            refusal = await self._order(command, and_d.parse_error, QUIET_S)
        if refusal is not None:
            raise _refused(action, refusal)
        shown = ""
        for _ in looks(ACTION_S):
            reading = await self._rest(action)
            if math.isclose(reading.value, 0.0, abs_tol=1e-12):
                return f"{action} done"
            shown = f"{reading.value:g} {reading.unit}"
            await asyncio.sleep(self.config.interval)
        raise DeviceError(
            f"the scale shows {shown} after {action}, not zero",
            hint="it may refuse: the load may lie outside the range of " + action,
        )

    async def _order(
        self, command: bytes, parse: Callable[[bytes], T | None], timeout_s: float
    ) -> T | None:
        """Send the ``command`` of an action, never twice; see :meth:`_exchange`."""
        if self._port.is_doubtful:  # a reading was lost: one that comes ends the doubt
            await self._exchange(self._dialect.read, self._dialect.parse_reading, REPLY_S)
        return await self._exchange(command, parse, timeout_s, once=True)

    async def _exchange(
        self,
        command: bytes,
        parse: Callable[[bytes], T | None],
        timeout_s: float,
        *,
        once: bool = False,
    ) -> T | None:
        """Send ``command`` and return the first line that ``parse`` takes; None when there is none.

        Other lines (an echo, damaged ones) are passed over.
        """
        return await self._port.ask(
            command,
            lambda line: parse(line.removeprefix(and_d.ACKNOWLEDGED)),
            timeout_s,
            once=once,
        )


def _refused(action: str, answer: Refusal) -> DeviceError:
    return DeviceError(
        f"the scale refuses to {action}: {answer.code} ({answer.reason})",
        hint="empty it, or bring the load into its range, and keep it at rest",
    )
