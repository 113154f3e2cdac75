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
    Driver,
    DriverConfig,
    In,
    LinkConfig,
    LinkError,
    ProtocolError,
    Row,
)
from rigd_drivers.can_bus import CanBus
from rigd_drivers.can_errand import Errand, Read, Script, Write, nearer
from rigd_drivers.can_node import HEARTBEAT_MS, Node
from rigd_drivers.can_pdo import configure, switch_off_rest
from rigd_drivers.can_profile import TransmitterProfile
from rigd_drivers.can_sheet import NodeConfig, Plan, contradictions, refuse
from rigd_drivers.canopen import objects, pdo
from rigd_drivers.canopen.inbox import Inbox
from rigd_drivers.canopen.objects import Entry
from rigd_drivers.device_file import FromFile

#: Low word of 1000h.
_PROFILE: Final = 404
#: What sets the value to zero (6125h): "zero" in ASCII, low byte first.
_ZERO: Final = int.from_bytes(b"zero", "little")
#: Bit of 6150h: the process value is not valid; 3 is an overload, 5 an underload.
_INVALID: Final = 1


class TransmitterConfig(NodeConfig):
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
            raise ValueError("'unit' must not be 0")
        if self.low >= self.high:
            raise ValueError(f"'low' ({self.low:g} N) must be below 'high' ({self.high:g} N)")
        return self


class ForceRow(Row):
    """The force in N, the number in the device, and its status (object 6150:01)."""

    force: float
    force_raw: float
    status: int


class Cia404Transmitter(Driver[TransmitterConfig, CanBus]):
    """A transmitter that gives its value at every SYNC; it only measures, so it is always safe."""

    Config: ClassVar[type[DriverConfig]] = TransmitterConfig
    title = "CiA 404 transmitter of a load cell on CAN"
    link_kind = "can"

    def __init__(self, config: TransmitterConfig, link: CanBus) -> None:
        super().__init__(config, link)
        self._inbox = Inbox(config.tpdo, config.node)
        self._newtons = float("nan")
        self._watched = False
        self._node: Node | None = None
        self._errand: Errand | None = None

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
    def contradictions(cls, config: TransmitterConfig, link: LinkConfig | None) -> Sequence[str]:
        """Return what in the EDS contradicts this transmitter on ``link``."""
        known = config.known
        tare = [(objects.AUTOZERO, _ZERO)] if known.tare else []
        writes = [(objects.HEARTBEAT_PRODUCER, HEARTBEAT_MS), *known.writes(), *tare]
        reads = [config.value, objects.DECIMAL_DIGITS, *known.reads()]
        return contradictions(config, link, Plan(_PROFILE, reads, writes, [config.tpdo]))

    def reserve(self) -> None:
        """See :class:`AnyDriver`: the node id is this device's alone."""
        self.link.claim(self.config.node, self.title)

    def open(self) -> None:
        """Set the transmitter up by SDO, reading everything back.

        Raises:
            LinkError: it does not answer.
            ProtocolError: it is another device, refuses the set-up, or has another unit.

        """
        config, link = self.config, self.link
        self.close()
        refuse(self.title, self.contradictions(config, link.config))
        node = self._node = Node(link, config.node, config.sheet())
        node.open(self.title, _PROFILE, config.serial)
        config.known.confirm(node)
        config.known.prepare(node)
        digits = node.read(objects.DECIMAL_DIGITS)
        self._newtons = config.unit / 10**digits
        told = f"1 count = {self._newtons:.6g} N ({digits} decimal digits by object 6132)"
        known = [node.identity, told, None if config.profile is None else str(config.profile)]
        self.identity = ", ".join(filter(None, known))
        self._check_unit(node)
        configure(node, config.tpdo)
        switch_off_rest(node, [config.tpdo])
        self._watched = False
        self._inbox = Inbox(config.tpdo, config.node, link.syncs)
        link.subscribe(config.tpdo.identifier, self._inbox.receive)
        link.on_resume(config.node, self._resume)
        node.start()

    def arm(self) -> None:
        """From now on take a silent or stopped node for failed; there is nothing to enable."""
        self._watched = True

    def read(self, t_ns: int) -> ForceRow | None:
        """Return force in N, process value and status; None if nothing answered the last SYNC.

        The force is NaN while the device reports that its value is not valid.

        Raises:
            DeviceError: the node reports an emergency, has restarted, or fell silent.
            ProtocolError: a frame has not the length mapped, or comes twice per SYNC.

        """
        node = self._opened()
        node.watch(forgive_silence=not self._watched)
        values = self._inbox.take(self.link.syncs)
        if values is None or self.link.behind:
            return None
        value, status = values[0], values[1] if len(values) > 1 else 0
        force = float("nan") if status & _INVALID else value * self._newtons
        return ForceRow.of(force=force, force_raw=value, status=status)

    def act(self, action: str) -> None:
        """Begin to set the value to zero.

        Raises:
            DeviceError: that is in progress.
            LinkError: it is not open.
            ValueError: unknown action.

        """
        node = self._opened()
        if action not in self.declare(self.config).actions:
            raise ValueError(f"the transmitter has no action {action!r}")
        if self._errand is not None:
            raise DeviceError(f"{node} is being set to zero already")
        self._errand = Errand(node, self._tare(node))

    def acted(self) -> str | None:
        """Return what the device shows once it is set to zero, None before.

        Raises:
            LinkError, ProtocolError, DeviceError: it does not answer, refuses, or shows no zero.

        """
        return None if self._errand is None else self._errand.advance()

    def make_safe(self) -> None:
        """Do nothing: it only measures."""

    def close(self) -> None:
        """Leave the transmitter pre-operational; closing twice is silent."""
        self._errand = None
        node, self._node = self._node, None
        if node is not None:
            node.close()

    def _opened(self) -> Node:
        if self._node is None:
            raise LinkError(f"the transmitter at node {self.config.node} is not open")
        return self._node

    def _resume(self) -> None:
        if self._node is not None:
            self._node.restart_quietly()

    def _check_unit(self, node: Node) -> None:
        found = node.read_optional(objects.PHYSICAL_UNIT)
        given = self.config.physical_unit
        if given is not None and found is not None and found != given:
            raise ProtocolError(
                f"{node} measures in the unit 0x{found:08X} (object 6131:01), `physical_unit` is "
                f"0x{given:08X}",
                hint="correct `physical_unit` and `unit`, or set the unit at the device",
            )

    def _tare(self, node: Node) -> Script:
        """Write "zero", and see that the value is nearer zero than before."""
        value = self.config.value
        try:
            before = yield Read(value)
            yield Write(objects.AUTOZERO, _ZERO)
            shown = yield Read(value)
            if not nearer(shown, 0, before, 1 << 8 * value.size):
                raise DeviceError(
                    f"{node} was ordered to zero and shows {shown} counts, before {before}",
                    hint="unload the cell: its manual states the range that can be set to zero",
                )
        finally:
            self._errand = None
        return f"{node} shows {shown} counts, before {before}"
