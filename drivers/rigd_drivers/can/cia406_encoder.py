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
    DriverConfig,
    In,
    ProtocolError,
    Row,
    wrong_entry,
)
from rigd_drivers.can.bus import CanBus
from rigd_drivers.can.canopen import objects, pdo
from rigd_drivers.can.canopen.counter import Unwrap
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.cia406_resolution import (
    WHOLE_OBJECT,
    Resolution,
    check_step,
    read_resolution,
)
from rigd_drivers.can.errand import Read, Script, Write, nearer
from rigd_drivers.can.node import Node
from rigd_drivers.can.profile import FIRST_TPDO, EncoderProfile, PdoChoice
from rigd_drivers.can.sensor import CanSensor, SensorConfig
from rigd_drivers.device_file import FromFile
from rigd_drivers.encoder_rows import AngleRow, PositionRow

#: Object of the preset value, of a position in 6004 and in 6020:01 (CiA 406; HYDAC HLT 1100, manual
#: 669824, section 9.3).
_PRESETS: Final = (objects.PRESET, objects.LINEAR_PRESET)
#: Options that only one kind has.
_OPTIONS: Final = {
    "rotary": ("counts_per_revolution", "gear_ratio"),
    "linear": ("distance_per_count",),
}


class EncoderConfig(SensorConfig):
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
    """Count at zero, of an absolute encoder, within half of whose range everything lies; none: that
    at opening, as for incremental."""
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
            raise wrong_entry(
                f"'{min(misplaced)}' belongs to 'kind: {other}'; remove it here", min(misplaced)
            )
        if self.kind == "linear" and self.distance_per_count is None:
            raise wrong_entry("'kind: linear' needs 'distance_per_count'", "distance_per_count")
        return self


class Cia406Encoder(CanSensor[EncoderConfig]):
    """An encoder that gives its position at every SYNC."""

    Config: ClassVar[type[DriverConfig]] = EncoderConfig
    title = "CiA 406 encoder on CAN"
    noun = "encoder"
    number = 406
    busy = ": its count is being set already"

    def __init__(self, config: EncoderConfig, link: CanBus) -> None:
        super().__init__(config, link, _position_pdo(config, objects.ENCODER_POSITION))
        self._is_angle = config.kind == "rotary"
        self._unwrap = Unwrap(WHOLE_OBJECT)
        self._zero = 0.0
        self._scale = float("nan")

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
    def transfers(
        cls, config: EncoderConfig
    ) -> tuple[Sequence[Entry], Sequence[tuple[Entry, int]], pdo.Pdo]:
        """See :class:`CanSensor`: the position, and the preset value."""
        position, sheet = objects.ENCODER_POSITION, config.sheet()
        if sheet is not None and config.kind == "linear" and sheet.find(position.index) is None:
            position = objects.LINEAR_POSITION
        preset = _PRESETS[position is objects.LINEAR_POSITION]
        writes = [] if config.preset is None else [(preset, config.preset)]
        return [position], writes, _position_pdo(config, position)

    def set_up(self, node: Node) -> None:
        """See :class:`CanSensor`: the scale, the range and zero of its counts."""
        config = self.config
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
        self._begin(resolution.range_of_counts(node, config.bits), node.read(position))

    def read(self, t_ns: int) -> AngleRow | PositionRow | None:
        """Return angle in rad or position in m, counts, and the node's NMT state (5: operational).

        None if nothing answered the SYNC of the cycle before.

        Raises:
            DeviceError: the node reports an emergency, has restarted, or fell silent.
            ProtocolError: a frame has not 4 bytes, comes twice per SYNC, or is out of range.

        """
        values = self.newest()
        if values is None:
            return None
        counts = self._unwrap.follow(self._within_span(values[0], self._unwrap.span))
        found = self.opened().state
        state = 0 if found is None else int(found)
        value = (counts - self._zero) * self._scale
        if self._is_angle:
            return AngleRow.of(angle=value, counts=counts, status=state)
        return PositionRow.of(position=value, counts=counts, status=state)

    def carry_out(self, node: Node) -> Script:
        """Write the count, and see that the position is nearer it than before."""
        span, preset = self._unwrap.span, self.config.preset or 0
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
        self._begin(span, shown)  # the step in its counts is no movement
        return f"{node} shows {shown} counts, before {before}"

    def _begin(self, span: int, shown: int) -> None:
        """Count from what the encoder shows."""
        unwrap = Unwrap(span, round(self.config.zero or 0.0))
        count = unwrap.follow(self._within_span(shown, span))
        self._unwrap = unwrap
        self._zero = count if self.config.zero is None else self.config.zero

    def _within_span(self, count: int, span: int) -> int:
        if count >= span:
            raise ProtocolError(
                f"{self._node} counts to {count}, beyond its range of {span}",
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
