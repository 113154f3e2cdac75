"""Reads a CiA 404 measuring device over CAN, such as the transmitter of a load cell.

Its process value (7130h, or 9130h) is in its physical unit (6131h) times 10 to the power of minus
its decimal digits (6132h). Source of these, of the status (6150h) and of autozero (6125h): Baumer
StrainLink, manual V3.05, pages 34 to 36.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Final, Self

from annotated_types import Ge, Le
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
from rigd_drivers.can.bus import CanBus
from rigd_drivers.can.canopen import objects, pdo
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.errand import Read, Script, Write, nearer
from rigd_drivers.can.node import Node
from rigd_drivers.can.profile import TransmitterProfile
from rigd_drivers.can.sensor import CanSensor, SensorConfig
from rigd_drivers.device_file import FromFile

#: What sets the value to zero (6125h): "zero" in ASCII, low byte first.
_ZERO: Final = int.from_bytes(b"zero", "little")
#: Bit of 6150h: the process value is not valid; 3 is an overload, 5 an underload.
_INVALID: Final = 1


class TransmitterConfig(SensorConfig):
    """Which transmitter it is, and what its value means."""

    profile: Annotated[TransmitterProfile, FromFile("cia404")] | None = None
    """What is known of this make: the name of a shipped profile (baumer-strainlink), a file of your
    own beside the rig file, or a profile written here. None: it is as CiA 404 has it."""
    unit: Annotated[float, In("N")]
    """Force for 1 of the physical unit that the device measures in, as in `1 N`, or, of a strain
    gauge, from its calibration on the rig; negative if it counts the other way."""
    physical_unit: Annotated[int, Ge(0), Le(0xFFFF_FFFF)] | None = None
    """Code of that unit in object 6131:01, from its manual; none: it is not compared."""
    low: Annotated[float, In("N")]
    """Least force that is possible."""
    high: Annotated[float, In("N")]
    """Largest force that is possible."""

    @property
    def known(self) -> TransmitterProfile:
        """The profile, or what CiA 404 has."""
        return self.profile or TransmitterProfile(title="CiA 404", source="CiA 404")

    @property
    def value(self) -> Entry:
        """Object of the process value."""
        return self.known.value.entry(objects.PROCESS_VALUE.name)

    @property
    def tpdo(self) -> pdo.Pdo:
        """The TPDO with value and status."""
        carrier, status = self.known.pdo, (objects.MEASURED_STATUS,) if self.known.status else ()
        identifier = carrier.cob_id + self.node
        entries = (self.value, *status)
        return pdo.Pdo(carrier.number, True, identifier, pdo.SYNCHRONOUS, entries)

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        if not self.unit or not math.isfinite(self.unit):
            raise wrong_entry("'unit' must not be 0", "unit")
        if self.low >= self.high:
            raise wrong_entry(
                f"'low' ({self.low:g} N) must be below 'high' ({self.high:g} N)", "low"
            )
        return self


class ForceRow(Row):
    """The force in N, the number in the device, and its status (object 6150:01)."""

    force: float
    force_raw: float
    status: int


class Cia404Transmitter(CanSensor[TransmitterConfig]):
    """A transmitter that gives its value at every SYNC."""

    Config: ClassVar[type[DriverConfig]] = TransmitterConfig
    title = "CiA 404 transmitter of a load cell on CAN"
    noun = "transmitter"
    number = 404
    busy = " is being set to zero already"

    def __init__(self, config: TransmitterConfig, link: CanBus) -> None:
        super().__init__(config, link, config.tpdo)
        self._newtons = float("nan")

    @classmethod
    def declare(cls, config: TransmitterConfig) -> Declaration:
        """Return the force and the number in the device."""
        doc = "sets the value to zero (object 6125)"
        return Declaration(
            channels=(
                Channel("force", "N", "force on the cell", config.low, config.high),
                Channel("force_raw", "count", "process value", raw_of="force"),
            ),
            row=ForceRow,
            actions={"tare": doc} if config.known.tare else {},
        )

    @classmethod
    def transfers(
        cls, config: TransmitterConfig
    ) -> tuple[Sequence[Entry], Sequence[tuple[Entry, int]], pdo.Pdo]:
        """See :class:`CanSensor`: the value, its digits, and autozero."""
        tare = [(objects.AUTOZERO, _ZERO)] if config.known.tare else []
        return [config.value, objects.DECIMAL_DIGITS], tare, config.tpdo

    def set_up(self, node: Node) -> str:
        """See :class:`CanSensor`: the force of a count, and the unit."""
        self._check_unit(node)
        digits = node.read(objects.DECIMAL_DIGITS)
        self._newtons = self.config.unit / 10**digits
        return f"1 count = {self._newtons:.6g} N ({digits} decimal digits by object 6132)"

    def read(self, t_ns: int) -> ForceRow | None:
        """Return force in N, process value and status; None if nothing answered the last SYNC.

        The force is NaN while the device reports that its value is not valid.

        Raises:
            DeviceError: the node reports an emergency, has restarted, or fell silent.
            ProtocolError: a frame has not the length mapped, or comes twice per SYNC.

        """
        values = self.newest()
        if values is None:
            return None
        value, status = values[0], values[1] if len(values) > 1 else 0
        force = float("nan") if status & _INVALID else value * self._newtons
        return ForceRow.of(force=force, force_raw=value, status=status)

    def _check_unit(self, node: Node) -> None:
        found = node.read_optional(objects.PHYSICAL_UNIT)
        given = self.config.physical_unit
        if given is not None and found is not None and found != given:
            raise ProtocolError(
                f"{node} measures in the unit 0x{found:08X} (object 6131:01), `physical_unit` is "
                f"0x{given:08X}",
                hint="correct `physical_unit` and `unit`, or set the unit at the device",
            )

    def carry_out(self, node: Node) -> Script:
        """Write "zero", and see that the value is nearer zero than before."""
        value = self.config.value
        before = yield Read(value)
        yield Write(objects.AUTOZERO, _ZERO)
        shown = yield Read(value)
        if not nearer(shown, 0, before, 1 << 8 * value.size):
            raise DeviceError(
                f"{node} was ordered to zero and shows {shown} counts, before {before}",
                hint="unload the cell: its manual states the range that can be set to zero",
            )
        return f"{node} shows {shown} counts, before {before}"
