"""Polls a strain-gauge or load-cell transmitter over Modbus, at its highest rate."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from typing import Annotated, ClassVar, Final, Literal, Self

from annotated_types import Gt, Le, MinLen
from pydantic import model_validator

from rigd.sdk import (
    Channel,
    Declaration,
    DeviceError,
    DriverConfig,
    In,
    ProtocolError,
    Row,
    wrong_entry,
)
from rigd_drivers.device_file import FromFile
from rigd_drivers.modbus.connection import ConnectionConfig
from rigd_drivers.modbus.device import ModbusDevice, silent_s
from rigd_drivers.modbus.exchange import Answer, Failure
from rigd_drivers.modbus.framing import Trouble
from rigd_drivers.modbus.pdu import ACKNOWLEDGED, EXCEPTIONS, Request
from rigd_drivers.modbus.registers import (
    Access,
    Address,
    Condition,
    Described,
    Expect,
    Register,
    WordOrder,
    Write,
)

#: Bits of the status word that the device's own flags take.
FLAGS: Final = {"stable": 1, "overload": 2, "underload": 4, "fault": 8}
#: Readings taken at opening to judge range and order (an unloaded cell flickers about zero, which
#: shows no order), and how often an action is tried.
_PROBES: Final = 20
_TRIES: Final = 3
#: So many readings in a row must make sense with their words swapped, and none as they are, before
#: the order is called wrong: an overload can look like that once.
_SUSPECTS: Final = 3
#: A float this small and not zero is two words swapped, not a force.
#: (0.5 N as 0x3F000000 reads 2.3e-41 when swapped.)
_LEAST_FLOAT: Final = 1e-30


class Action(Described):
    """An action that a person may request of the device."""

    doc: str
    """What it does, in a line."""
    writes: Annotated[tuple[Write, ...], MinLen(1)]
    """What is written, in order."""
    repeats: bool = False
    """Done twice it is as done once: a write that is not answered is made again."""


class TransmitterMap(Access):
    """Registers of a transmitter, its flags, and the settings that it must have."""

    force: Register
    """The reading."""
    scale: Annotated[float, In("N/count")] | None = None
    """Force per count of the register (per 1.0 of a float)."""
    negative: Condition | None = None
    """The reading is a magnitude, and negative while this holds."""
    status: Mapping[Literal["stable", "overload", "underload", "fault"], Condition] = {}
    """The device's flags; 'fault' ends the run."""
    identity: Mapping[str, Address] = {}
    """Registers that identify the device, for the recording."""
    expect: tuple[Expect, ...] = ()
    """Settings it must have."""
    actions: Mapping[str, Action] = {}
    """What a person may ask of it, such as tare."""

    @model_validator(mode="after")
    def _sign_of_one_reading(self) -> Self:
        if self.negative is not None:
            sign = range(self.negative.address, self.negative.address + 1)
            if len(self.reads([sign, self.force.addresses])) > 1:
                raise wrong_entry(
                    "'negative' and 'force' must be read in one request, to be of one reading: "
                    "raise 'bridge'",
                    "negative",
                )
        return self

    def polled(self) -> list[range]:
        """Return the spans of registers that make a row."""
        flags = [*self.status.values(), *([] if self.negative is None else [self.negative])]
        return [self.force.addresses, *(range(f.address, f.address + 1) for f in flags)]


class TransmitterConfig(ConnectionConfig):
    """The connection of the transmitter, its register map, and the forces it may read."""

    map: Annotated[TransmitterMap, FromFile("modbus-transmitter")]
    """Name of a shipped map (laumas-tlb4, seneca-z-sg2, tuna-id551), a
    file of your own beside the rig file, such as my_device.yaml, or a map written here."""
    low: Annotated[float, In("N")]
    """Smallest force that the cell can bear; a reading beyond is not believed at opening."""
    high: Annotated[float, In("N")]
    """Largest force that the cell can bear."""
    rate: Annotated[float, In("Hz"), Gt(0), Le(1000)] = 50.0
    """Rows per second asked for; an RTU line at 9600 baud allows about 30."""
    scale: Annotated[float, In("N/count")] | None = None
    """Force per count, instead of the map's; its sign turns the direction."""
    word_order: WordOrder | None = None
    """Which word of a 32-bit number comes first, instead of the map's."""

    @model_validator(mode="after")
    def _scaled(self) -> Self:
        if self.low >= self.high:
            raise wrong_entry(
                f"'low' ({self.low:g} N) must be below 'high' ({self.high:g} N)", "low"
            )
        if self.force_per_count() is None:
            raise wrong_entry(
                f"the map of the {self.map.title} has no scale: give 'scale', such as "
                "'0.0980665 N/count' for an instrument that shows kg with two decimals",
                "scale",
            )
        if self.force_per_count() == 0:
            raise wrong_entry("'scale' must not be zero", "scale")
        return self

    def force_per_count(self) -> float | None:
        """Return the scale in N per count: given here, or the map's."""
        return self.map.scale if self.scale is None else self.scale

    @property
    def newtons_per_count(self) -> float:
        """The scale, known to be there and not zero once the options are read."""
        return self.force_per_count() or 1.0


class ForceRow(Row):
    """Force, the number in its register, and the status bits of :class:`ModbusTransmitter`."""

    force: float
    force_raw: float
    status: int


class ModbusTransmitter(ModbusDevice[TransmitterConfig]):
    """A load-cell or strain-gauge transmitter; it takes no setpoints.

    Status bits: stable 1, overload 2, underload 4, and the line's (see :class:`ModbusDevice`).
    """

    Config: ClassVar[type[DriverConfig]] = TransmitterConfig
    title: ClassVar[str] = "strain-gauge or load-cell transmitter, Modbus TCP or RTU"

    def __init__(self, config: TransmitterConfig, link: None) -> None:
        super().__init__(config, link, config.map, config.rate)
        self._map = config.map
        self._order: WordOrder = config.word_order or config.map.word_order
        self._scale = config.newtons_per_count
        self._reads = config.map.reads(config.map.polled())
        self._turn = 0
        self._words: dict[int, int] = {}
        self._acting: str | None = None
        self._repeats = False  # a write of that may be made again
        self._to_write: deque[Request] = deque()
        self._tries = 0
        self._refused: str | None = None
        self._suspects = 0

    @classmethod
    def declare(cls, config: TransmitterConfig) -> Declaration:
        """Return the force, and the actions that the map has; rows come at its own pace."""
        least, most = sorted(end / config.newtons_per_count for end in (config.low, config.high))
        raw = Channel("force_raw", "count", "number in the register", least, most, raw_of="force")
        return Declaration(
            channels=(Channel("force", "N", "force on the cell", config.low, config.high), raw),
            row=ForceRow,
            actions={name: action.doc for name, action in config.map.actions.items()},
            every_cycle=False,
            silent_s=silent_s(config, config.rate),
        )

    def prove(self) -> None:
        """Check the settings, and take a few readings that must be possible.

        Both words of a zero are the same: with no force on the cell at all, their order is judged
        as soon as there is some, in the cycle.

        Raises:
            ProtocolError: another device, or readings that cannot be: names the option to try.

        """
        self._turn, self._suspects, self._acting = 0, 0, None
        self._to_write.clear()
        self.check(self._map.expect)
        numbers = [f"{k} {self.fetch_word(a)}" for k, a in self._map.identity.items()]
        self.identity = ", ".join([self._map.title, *numbers, f"map {self._map.standing}"])
        hints = 0
        for _ in range(_PROBES):
            self._words = self.fetch(self._reads)
            row = self._row()
            if row is not None and not self._possible(row.force):
                raise ProtocolError(
                    f"{self.client.where} reads {row.force:g} N, beyond {self.config.low:g} N to "
                    f"{self.config.high:g} N",
                    hint="unload the cell, or correct 'scale', 'low' and 'high'",
                )
            hints += self._hints_at_order()
            if hints >= _SUSPECTS:
                return
            time.sleep(1.0 / self.config.rate)

    def arm(self) -> None:
        """Do nothing: it only measures."""

    def read(self, t_ns: int) -> ForceRow | None:
        """Return force in N, counts and status once all of a row has come, else None.

        Raises:
            LinkError: the connection is lost.
            DeviceError: the device reports a fault, or refuses to be read.
            ProtocolError: the words have been swapped.

        """
        answer = self.take()
        row = None if answer is None else self._took(answer)
        if self.client.free():
            self._ask()
        return row

    def act(self, action: str) -> None:
        """Begin tare, zero or what else the map has; see :class:`TransmitterMap`."""
        if action not in self._map.actions:
            known = ", ".join(self._map.actions) or "none"
            raise ValueError(f"there is no action {action!r}; known: {known}")
        if self._acting is not None:
            raise DeviceError(f"{self._acting} is still under way")
        self._acting, self._refused, self._tries = action, None, 0
        self._repeats = self._map.actions[action].repeats
        self._to_write = deque(self._map.writes(self._map.actions[action].writes))

    def acted(self) -> str | None:
        """Return that the action is done, once.

        Raises:
            DeviceError: the device refused it, or did not answer.

        """
        if self._acting is None or self._to_write:
            return None
        action, self._acting = self._acting, None
        if self._refused is not None:
            raise DeviceError(f"{action}: {self._refused}")
        return f"{action}: accepted"

    def make_safe(self) -> None:
        """Do nothing: it only measures, and moves nothing."""

    def failed(self, failure: Failure) -> None:
        """Ask again: the action if it may be repeated, or the row from its beginning."""
        self._turn = 0
        if not self._to_write or failure.request is not self._to_write[0]:
            return
        if failure.code == ACKNOWLEDGED:
            self._to_write.popleft()
            return
        self._tries += 1
        again = self._repeats or failure.trouble is Trouble.REFUSED  # it is busy: it did nothing
        if not again or self._tries >= _TRIES:
            self._to_write.clear()
            self._refused = f"no answer to the {failure.request.text}: it may be done or not"

    def refused(self, failure: Failure) -> bool:
        """Note a refusal; return True if it was of an action."""
        if not self._to_write or failure.request is not self._to_write[0]:
            return False
        self._to_write.clear()
        self._refused = f"refused: {EXCEPTIONS.get(failure.code, f'exception {failure.code}')}"
        return True

    def _ask(self) -> None:
        """Send the next request: of a row begun, of an action, or of a new row when it is time."""
        if self._turn == 0 and self._to_write:
            self.client.start(self._to_write[0])
        elif self._turn > 0 or self.due():
            self.client.start(self._reads[self._turn].request)

    def _took(self, answer: Answer) -> ForceRow | None:
        if self._to_write and answer.request is self._to_write[0]:
            self._to_write.popleft()
            return None
        self._words |= self._reads[self._turn].words(answer.words)
        self._turn = (self._turn + 1) % len(self._reads)
        return self._row() if self._turn == 0 else None

    def _row(self) -> ForceRow | None:
        """Return the row; None if its words may be in the wrong order."""
        flags = 0
        for name, condition in self._map.status.items():
            if condition.holds(self._words):
                flags |= FLAGS[name]
        if flags & FLAGS["fault"]:
            word = self._words[self._map.status["fault"].address]
            raise DeviceError(
                f"{self.client.where}: the transmitter reports a fault (status word {word:#06x})",
                hint="check the cell's cable and the instrument's display",
            )
        count = self._count(self._order)
        force = count * self._scale
        if not self._possible(force) and self._swapped(force):
            return None
        if self._hints_at_order():
            self._suspects = 0
        return ForceRow.of(force=force, force_raw=count, status=flags | self.client.status())

    def _hints_at_order(self) -> bool:
        """Return whether the reading depends on the order of its words: that of zero does not."""
        return self._count(self._order) != self._count(self._other_order())

    def _other_order(self) -> WordOrder:
        return "low-first" if self._order == "high-first" else "high-first"

    def _count(self, order: WordOrder) -> float:
        count = self._map.force.decode(self._words, order)
        negative = self._map.negative
        return -count if negative is not None and negative.holds(self._words) else count

    def _swapped(self, force: float) -> bool:
        """Return whether the words, taken the other way round, make a possible force.

        Raises:
            ProtocolError: they did so several times on end.

        """
        other = self._other_order()
        swapped = self._count(other) * self._scale
        if self._map.force.count == 1 or not self._possible(swapped):
            return False
        self._suspects += 1
        if self._suspects >= _SUSPECTS:
            raise ProtocolError(
                f"{self.client.where} reads {force:g} N, which cannot be; with its two words "
                f"swapped it is {swapped:g} N",
                hint=f"try 'word_order: {other}'",
            )
        return True

    def _possible(self, force: float) -> bool:
        if self._map.force.type == "float32" and 0 < abs(force / self._scale) < _LEAST_FLOAT:
            return False
        return self.config.low <= force <= self.config.high
