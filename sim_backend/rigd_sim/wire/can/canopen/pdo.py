"""Simulates the process data objects (PDOs) of a node, and packs their values fast.

The rules for the communication and mapping objects are those of CiA 301, 7.5.2.35 to 7.5.2.38. A
master can change the mapping only while the PDO is disabled (bit 31 of its COB-ID) and empty
(sub-index 0 of the mapping is 0). The node aborts any other change with 0x08000022. It aborts a
change of the inhibit time, or of the other bits of the COB-ID, while the PDO is enabled with
0x06090030, and so the enabling of a PDO that is empty.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Final

from rigd_sim.wire.can.canopen.dictionary import Abort, AbortCode, Dictionary, Entry, Kind

INVALID: Final = 1 << 31
EXTENDED: Final = 1 << 29
COB_MASK: Final = 0x1FFFFFFF
#: Transmission types up to here happen at SYNC; 241 to 253 are reserved or for RTR.
LAST_SYNCHRONOUS: Final = 240
FIRST_EVENT: Final = 254
#: Mapping entries that a PDO has place for.
PLACES: Final = 8


class Pdo:
    """One PDO with its objects in the dictionary; ``changed`` gets a new configuration."""

    def __init__(
        self,
        dictionary: Dictionary,
        number: int,
        cob_id: int,
        *,
        receive: bool,
        changed: Callable[[], None],
        refused: Callable[[], bool],
        event_timer: bool = False,
        inhibit: int = 0,
    ) -> None:
        self._dictionary = dictionary
        self._changed = changed
        self._refused = refused
        base = number + (0x1400 if receive else 0x1800)
        subs = [
            Entry(base, 1, Kind.U32, cob_id | INVALID, writable=True,
                  check=self._check_cob_id, changed=self._reconfigure),
            Entry(base, 2, Kind.U8, 255, writable=True,
                  check=_check_type, changed=self._reconfigure),
        ]  # fmt: skip
        self.inhibit: Entry | None = None
        if not receive:
            self.inhibit = Entry(
                base, 3, Kind.U16, inhibit, writable=True, check=self._check_inhibit
            )
            subs.append(self.inhibit)
        self.event_timer: Entry | None = None
        if event_timer:
            self.event_timer = Entry(base, 5, Kind.U16, 0, writable=True, changed=self._reconfigure)
            subs.append(self.event_timer)
        self._cob_id, self._type = dictionary.array(base, subs)[:2]
        mapping = base + 0x200
        self._places = dictionary.array(
            mapping,
            [
                Entry(mapping, sub, Kind.U32, 0, writable=True, check=self._check_place)
                for sub in range(1, PLACES + 1)
            ],
        )
        self._count = dictionary.find(mapping, 0)
        self._count.value = self._count.default = 0
        self._count.writable = True
        self._count.check = self._check_count
        self._count.changed = self._reconfigure
        self.entries: tuple[Entry, ...] = ()
        self._packer = struct.Struct("<")
        #: Cached from the objects, for the cycle.
        self.enabled = False
        self.cob_id = 0
        self.synchronous = False
        self.period = 1

    @property
    def length(self) -> int:
        """Bytes of data."""
        return self._packer.size

    def pack(self) -> bytes:
        """Return the data of a TPDO."""
        return self._packer.pack(*[entry.value for entry in self.entries])

    def unpack(self, data: bytes) -> tuple[int, ...]:
        """Return the values of an RPDO in the order of ``entries``."""
        return self._packer.unpack_from(data)

    def refresh(self) -> None:
        """Take over the values of the objects, such as after a reset."""
        cob_id, kind, count = self._cob_id.value, self._type.value, self._count.value
        self.entries = tuple(self._target(place.value) for place in self._places[:count])
        self._packer = struct.Struct("<" + "".join(entry.kind.letter for entry in self.entries))
        self.enabled = not cob_id & INVALID and bool(self.entries)
        self.cob_id = cob_id & COB_MASK
        self.synchronous = kind <= LAST_SYNCHRONOUS
        self.period = max(kind, 1)

    def _reconfigure(self, _: int) -> None:
        self.refresh()
        self._changed()

    def _check_cob_id(self, value: int) -> None:
        now = self._cob_id.value
        if not now & INVALID and (now ^ value) & ~INVALID:
            raise Abort(AbortCode.VALUE_RANGE)
        if value & EXTENDED or value & COB_MASK > 0x7FF or not value & COB_MASK:
            raise Abort(AbortCode.VALUE_RANGE)
        if not value & INVALID and not self._count.value:
            raise Abort(AbortCode.VALUE_RANGE)

    def _check_inhibit(self, _: int) -> None:
        if not self._cob_id.value & INVALID:
            raise Abort(AbortCode.VALUE_RANGE)

    def _check_count(self, count: int) -> None:
        self._check_place(0, empty=False)
        if count > PLACES:
            raise Abort(AbortCode.PDO_TOO_LONG)
        mapped = [self._target(place.value) for place in self._places[:count]]
        if sum(entry.kind.bits for entry in mapped) > 64:
            raise Abort(AbortCode.PDO_TOO_LONG)

    def _check_place(self, value: int, *, empty: bool = True) -> None:
        if self._refused():
            raise Abort(AbortCode.NOT_MAPPABLE)
        if not self._cob_id.value & INVALID or (empty and self._count.value):
            raise Abort(AbortCode.DEVICE_STATE)
        if value:
            self._target(value)

    def _target(self, mapping: int) -> Entry:
        """Return the entry that ``mapping`` (index, sub-index, bits) names."""
        entry = self._dictionary.find(mapping >> 16, mapping >> 8 & 0xFF)
        if not entry.mappable or entry.kind.bits != mapping & 0xFF:
            raise Abort(AbortCode.NOT_MAPPABLE)
        return entry


def _check_type(value: int) -> None:
    if LAST_SYNCHRONOUS < value < FIRST_EVENT:
        raise Abort(AbortCode.VALUE_RANGE)
