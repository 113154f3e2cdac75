"""Reads a CiA 406 encoder over CAN, either rotary or linear (such as a measuring wheel)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Final, Literal, Self

from annotated_types import Ge, Gt, Le
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
from rigd_drivers.can_profile import FIRST_TPDO, EncoderProfile, PdoChoice
from rigd_drivers.can_sheet import NodeConfig, Plan, contradictions, refuse
from rigd_drivers.canopen import objects, pdo
from rigd_drivers.canopen.counter import Unwrap
from rigd_drivers.canopen.inbox import Inbox
from rigd_drivers.canopen.objects import Entry
from rigd_drivers.cia406_resolution import (
    WHOLE_OBJECT,
    Resolution,
    check_step,
    read_resolution,
)
from rigd_drivers.device_file import FromFile
from rigd_drivers.encoder_rows import AngleRow, PositionRow

#: Low word of 1000h.
_PROFILE: Final = 406
#: Object of the preset value, of a position in 6004 and in 6020:01 (CiA 406; HYDAC HLT 1100, manual
#: 669824, section 9.3).
_PRESETS: Final = (objects.PRESET, objects.LINEAR_PRESET)
#: Options that only one kind has.
_OPTIONS: Final = {
    "rotary": ("counts_per_revolution", "gear_ratio"),
    "linear": ("distance_per_count",),
}


class EncoderConfig(NodeConfig):
    """Which encoder it is, and how its counts become an angle or a position."""

    profile: Annotated[EncoderProfile, FromFile("cia406")] | None = None
    """What is known of this make of encoder: a file of your own beside the rig file, such as
    my_encoder.yaml, or a profile written here. None: it is as CiA 406 has it."""
    kind: Literal["rotary", "linear"]
    """Whether it gives an angle or a position."""
    counts_per_revolution: Annotated[float, In("count/rad"), Gt(0)] | None = None
    """Rotary: counts per revolution of its shaft; none: as it reports (object 6001 if its scaling
    is on, else 6501)."""
    gear_ratio: Annotated[float, In("1"), Gt(0)] = 1.0
    """Rotary: turns of its shaft per turn of what is measured."""
    distance_per_count: Annotated[float, In("m/count"), Gt(0)] | None = None
    """Linear: travel per count."""
    bits: Annotated[int, Ge(8), Le(32)] | None = None
    """The position rolls over after so many bits: 16, 24, 32; none: as it reports (object 6002 if
    its scaling is on, else 6501 and 6502)."""
    inverted: bool = False
    """Whether counting up is the rig's negative direction."""
    zero: Annotated[float, In("count")] | None = None
    """Count at zero, of an absolute encoder; none: that at opening, as for incremental."""
    preset: Annotated[int, Ge(0), Le(0x7FFF_FFFF)] | None = None
    """Count that the action `preset` gives the present position (object 6003, or 6010:01 of linear
    encoders without 6004); none: it has no such action."""

    @property
    def pdo(self) -> PdoChoice:
        """The TPDO that carries the position."""
        return FIRST_TPDO if self.profile is None else self.profile.pdo

    @model_validator(mode="after")
    def _only_options_of_the_kind(self) -> Self:
        other = "linear" if self.kind == "rotary" else "rotary"
        misplaced = self.model_fields_set.intersection(_OPTIONS[other])
        if misplaced:
            raise ValueError(f"'{min(misplaced)}' belongs to 'kind: {other}'; remove it here")
        if self.kind == "linear" and self.distance_per_count is None:
            raise ValueError("'kind: linear' needs 'distance_per_count'")
        return self


class Cia406Encoder(Driver[EncoderConfig, CanBus]):
    """An encoder that gives its position at every SYNC; it only measures, so it is always safe."""

    Config: ClassVar[type[DriverConfig]] = EncoderConfig
    title = "CiA 406 encoder on CAN"
    link_kind = "can"

    def __init__(self, config: EncoderConfig, link: CanBus) -> None:
        super().__init__(config, link)
        self._is_angle = config.kind == "rotary"
        self._tpdo = _position_pdo(config, objects.ENCODER_POSITION)
        self._inbox = Inbox(self._tpdo, config.node)
        self._unwrap = Unwrap(WHOLE_OBJECT)
        self._zero = 0.0
        self._scale = float("nan")
        self._watched = False
        self._node: Node | None = None
        self._errand: Errand | None = None

    @classmethod
    def declare(cls, config: EncoderConfig) -> Declaration:
        """Return the angle or the position, and the counts."""
        row: type[Row]
        if config.kind == "rotary":
            row, converted = AngleRow, Channel("angle", "rad", "angle of what the encoder measures")
        else:
            row, converted = PositionRow, Channel("position", "m", "position")
        counts = Channel("counts", "count", "encoder counts, unwrapped", raw_of=converted.name)
        doc = "sets the count of the present position to `preset`"
        actions = {} if config.preset is None else {"preset": doc}
        return Declaration(channels=(converted, counts), row=row, actions=actions)

    @classmethod
    def contradictions(cls, config: EncoderConfig, link: LinkConfig | None) -> Sequence[str]:
        """Return what in the EDS contradicts this encoder on ``link``."""
        writes = [(objects.HEARTBEAT_PRODUCER, HEARTBEAT_MS)]
        position, sheet = objects.ENCODER_POSITION, config.sheet()
        if sheet is not None and config.kind == "linear" and sheet.find(position.index) is None:
            position = objects.LINEAR_POSITION
        reads = [position]
        if config.profile is not None:
            writes += config.profile.writes()
            reads += config.profile.reads()
        if config.preset is not None:
            linear = position is objects.LINEAR_POSITION
            writes.append((_PRESETS[linear], config.preset))
        plan = Plan(_PROFILE, reads, writes, [_position_pdo(config, position)])
        return contradictions(config, link, plan)

    def reserve(self) -> None:
        """See :class:`AnyDriver`: the node id is this device's alone."""
        self.link.claim(self.config.node, self.title)

    def open(self) -> None:
        """Set the encoder up by SDO, reading everything back.

        Raises:
            LinkError: it does not answer.
            ProtocolError: it is another device, refuses the set-up, or has another resolution.

        """
        config, link = self.config, self.link
        self.close()
        refuse(self.title, self.contradictions(config, link.config))
        node = self._node = Node(link, config.node, config.sheet())
        node.open(self.title, _PROFILE, config.serial)
        self.identity = node.identity
        if config.profile is not None:
            config.profile.confirm(node)
            config.profile.prepare(node)
            self.identity += f", {config.profile}"
        position = self._position_object(node)
        self._tpdo = _position_pdo(config, position)
        resolution = read_resolution(node)
        if position is objects.LINEAR_POSITION:
            resolution = Resolution()
        scale = config.distance_per_count
        if scale is None:
            given = config.counts_per_revolution
            scale = 1.0 / (resolution.counts_per_radian(node, given) * config.gear_ratio)
        elif position is objects.LINEAR_POSITION:
            check_step(node, scale)
        self._scale = -scale if config.inverted else scale
        configure(node, self._tpdo)
        switch_off_rest(node, [self._tpdo])
        self._unwrap = Unwrap(resolution.range_of_counts(node, config.bits))
        count = self._unwrap.follow(self._within_span(node.read(position)))
        self._zero = count if config.zero is None else config.zero
        self._watched = False
        self._inbox = Inbox(self._tpdo, config.node, link.syncs)
        link.subscribe(self._tpdo.identifier, self._inbox.receive)
        link.on_resume(config.node, self._resume)
        node.start()

    def arm(self) -> None:
        """From now on take a silent or stopped node for failed; there is nothing to enable."""
        self._watched = True

    def read(self, t_ns: int) -> AngleRow | PositionRow | None:
        """Return angle in rad or position in m, counts, and the node's NMT state (5: operational).

        None if nothing answered the SYNC of the cycle before.

        Raises:
            DeviceError: the node reports an emergency, has restarted, or fell silent.
            ProtocolError: a frame has not 4 bytes, comes twice per SYNC, or is out of range.

        """
        node = self._node
        if node is None:
            raise LinkError(f"the encoder at node {self.config.node} is not open")
        node.watch(forgive_silence=not self._watched)
        values = self._inbox.take(self.link.syncs)
        if values is None or self.link.behind:
            return None
        counts = self._unwrap.follow(self._within_span(values[0]))
        state = 0 if node.state is None else int(node.state)
        value = (counts - self._zero) * self._scale
        if self._is_angle:
            return AngleRow.of(angle=value, counts=counts, status=state)
        return PositionRow.of(position=value, counts=counts, status=state)

    def act(self, action: str) -> None:
        """Begin to set the count to `preset`.

        Raises:
            DeviceError: that is in progress.
            LinkError: it is not open.
            ValueError: unknown action.

        """
        if action != "preset" or self.config.preset is None:
            raise ValueError(f"the encoder has no action {action!r}")
        if self._node is None:
            raise LinkError(f"the encoder at node {self.config.node} is not open")
        if self._errand is not None:
            raise DeviceError(f"{self._node}: its count is being set already")
        self._errand = Errand(self._node, self._set_count(self._node, self.config.preset))

    def acted(self) -> str | None:
        """Return what the encoder shows once its count is set, None before.

        Raises:
            LinkError, ProtocolError, DeviceError: it does not answer, refuses, or counts on.

        """
        return None if self._errand is None else self._errand.advance()

    def _set_count(self, node: Node, preset: int) -> Script:
        """Write the count, and see that the position is nearer it than before."""
        span = self._unwrap.span
        try:
            if preset >= span:
                raise DeviceError(
                    f"{node} counts to {span - 1}, `preset` is {preset}", hint="correct `preset`"
                )
            (position,) = self._tpdo.entries
            before = yield Read(position)
            yield Write(_PRESETS[position is objects.LINEAR_POSITION], preset)
            shown = yield Read(position)
            if not nearer(shown, preset, before, span):
                raise DeviceError(
                    f"{node} took the preset value {preset} and shows {shown}, before {before}",
                    hint="its manual states when it takes a preset: at rest, or enabled first",
                )
        finally:
            self._errand = None
        self._unwrap = Unwrap(span)  # the step in its counts is no movement
        count = self._unwrap.follow(shown)
        self._zero = count if self.config.zero is None else self.config.zero
        return f"{node} shows {shown} counts, before {before}"

    def make_safe(self) -> None:
        """Do nothing: it only measures."""

    def close(self) -> None:
        """Leave the encoder pre-operational; closing twice is silent."""
        self._errand = None
        node, self._node = self._node, None
        if node is not None:
            node.close()

    def _resume(self) -> None:
        if self._node is not None:
            self._node.restart_quietly()

    def _within_span(self, count: int) -> int:
        if count >= self._unwrap.span:
            raise ProtocolError(
                f"{self._node} counts to {count}, beyond its range of {self._unwrap.span}",
                hint="correct `bits`",
            )
        return count

    def _position_object(self, node: Node) -> Entry:
        """Return the object with the position: 6004, or 6020:01 of linear encoders without it."""
        if self.config.kind == "linear" and node.read_optional(objects.ENCODER_POSITION) is None:
            return objects.LINEAR_POSITION
        return objects.ENCODER_POSITION


def _position_pdo(config: EncoderConfig, position: Entry) -> pdo.Pdo:
    carrier = config.pdo
    identifier = carrier.cob_id + config.node
    return pdo.Pdo(carrier.number, True, identifier, pdo.SYNCHRONOUS, (position,))
