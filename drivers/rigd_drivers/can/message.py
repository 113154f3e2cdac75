"""Reads a message that a sensor sends by itself on a CAN bus, as a DBC file describes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, ClassVar, Final, Self

from annotated_types import Ge, Gt, Le
from pydantic import Field, ValidationInfo, field_validator, model_validator

from rigd.sdk import Declaration, Driver, DriverConfig, In, LinkError, ProtocolError
from rigd_drivers.can.bus import OVERFLOW_HINT, CanBus, overflow
from rigd_drivers.can.canopen import frames
from rigd_drivers.can.dbc import Message, read_message

#: Bits of the status word: a value lies outside the range that the DBC states; frames of a wrong
#: length came since the row before.
OUTSIDE: Final = 1
MALFORMED: Final = 2
#: So many frames of a wrong length in a row are no disturbance: the DBC is of another device.
_MALFORMED_IN_A_ROW: Final = 20


class CanMessageConfig(DriverConfig):
    """Which message it is, and which of its signals become channels."""

    dbc: str
    """DBC file, beside the rig file."""
    message: str
    """Name of the message in it."""
    page: Annotated[int, Ge(0)] | None = None
    """What the multiplexer of the message selects, if it has one; frames of other pages are not
    this device's."""
    signals: tuple[str, ...] = ()
    """Signals that become channels; none: all. A channel is named as its signal, in lower case."""
    units: dict[str, str] = Field(default_factory=dict)
    """Unit of a signal, where the DBC has none or rigd does not know it: `{Load: kg}`."""
    timeout: Annotated[float, In("s"), Gt(0), Le(60)] = 0.5
    """The sensor has failed once no frame came for so long."""

    @field_validator("dbc")
    @classmethod
    def _is_there(cls, name: str, info: ValidationInfo) -> str:
        """Find the file; ``folder`` in the context is the folder of the rig file."""
        path = Path((info.context or {}).get("folder") or Path.cwd()) / name
        if not path.is_file():
            raise ValueError(f"there is no file {path}")
        return str(path.resolve())

    @model_validator(mode="after")
    def _is_described(self) -> Self:
        self.read()
        return self

    def files(self) -> Mapping[Path, str]:
        """Return the DBC; see :class:`DriverConfig`."""
        path = Path(self.dbc)
        return {path: path.read_text("utf-8", errors="replace")}

    def read(self) -> Message:
        """Return what the DBC has of the message.

        Raises:
            ValueError: it has no such message, page, signal or unit.
        """
        return read_message(Path(self.dbc), self.message, self.page, self.units, self.signals)


class CanMessage(Driver[CanMessageConfig, CanBus]):
    """A sensor that sends one message by itself; it is never spoken to, so it is always safe.

    Of several frames between two cycles the newest one counts.
    """

    Config: ClassVar[type[DriverConfig]] = CanMessageConfig
    title: ClassVar[str] = "sensor on CAN, by a message of a DBC file"
    link_kind: ClassVar[str] = "can"
    reads_when_safe: ClassVar[bool] = True

    def __init__(self, config: CanMessageConfig, link: CanBus) -> None:
        super().__init__(config, link)
        self._message = config.read()
        known = self._message.known
        self._identifier = known.frame_id | (frames.EXTENDED if known.is_extended_frame else 0)
        self._length: int = known.length
        self._forget()

    def _forget(self) -> None:
        self._newest: tuple[float, ...] | None = None
        self._malformed = 0
        self._malformed_in_a_row = 0
        self._found_length = 0

    @classmethod
    def declare(cls, config: CanMessageConfig) -> Declaration:
        """Return a channel for every signal."""
        return Declaration(
            channels=tuple(signal.channel for signal in config.read().signals),
            plain_rows=True,
            has_status=True,
            every_cycle=False,
            silent_s=config.timeout,
        )

    def open(self) -> None:
        """Wait for the first frame.

        Raises:
            LinkError: none came.
            ProtocolError: those that came have another length than in the DBC.
        """
        self._forget()
        name = frames.describe(self._identifier)
        self.link.listen(self._identifier, self._take)
        came = self.link.wait(
            lambda: self._newest is not None or self._malformed > 0, self.config.timeout
        )
        if not came and (lost := self.link.lost):
            raise LinkError(
                f"{self.link.name} brings no {name} within {self.config.timeout:g} s; "
                f"{overflow(lost)}",
                hint=OVERFLOW_HINT,
            )
        if not came:
            page = "" if self.config.page is None else f" with page {self.config.page}"
            raise LinkError(
                f"{self.link.name} brings no {name}, message {self.config.message}{page}, within "
                f"{self.config.timeout:g} s",
                hint="check supply, wires and bit rate of the sensor; or give `timeout` more time",
            )
        if self._newest is None:
            raise self._wrong_length()
        self.identity = f"{self.config.message}, {name}, by {Path(self.config.dbc).name}"

    def arm(self) -> None:
        """Do nothing: it only measures."""

    def read(self, t_ns: int) -> Sequence[float] | None:
        """Return the values in SI and the status; None if no frame came since the last call.

        Raises:
            ProtocolError: its frames have another length than in the DBC, one after the other.
        """
        if self._malformed_in_a_row >= _MALFORMED_IN_A_ROW:
            raise self._wrong_length()
        values, self._newest = self._newest, None
        if values is None:
            return None
        status = MALFORMED if self._malformed else 0
        self._malformed = 0
        for value, signal in zip(values, self._message.signals, strict=True):
            if not signal.low <= value <= signal.high:
                status |= OUTSIDE
        return (*values, status)

    def make_safe(self) -> None:
        """Do nothing: it only measures."""

    def _take(self, data: bytes) -> None:
        if len(data) != self._length:
            self._malformed += 1
            self._malformed_in_a_row += 1
            self._found_length = len(data)
            return
        values = self._message.values(data)
        if values is not None:
            self._malformed_in_a_row = 0
            self._newest = values

    def _wrong_length(self) -> ProtocolError:
        return ProtocolError(
            f"{frames.describe(self._identifier)} has {self._found_length} bytes, message "
            f"{self.config.message} of {Path(self.config.dbc).name} has {self._length}",
            hint="the DBC is of another device or version, or two devices send this identifier",
        )
