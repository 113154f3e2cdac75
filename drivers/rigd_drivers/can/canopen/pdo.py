"""Packs entries into process data objects (PDOs), and configures the PDO mapping of a node.

Source: CiA 301 (4.2.0), sections 7.5.2.35 to 7.5.2.38.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from rigd_drivers.can.canopen.objects import Entry

SYNCHRONOUS: Final = 1  #: transmission type: at every SYNC
EVENT_DRIVEN: Final = 255  #: transmission type: at once
INVALID: Final = 0x8000_0000  #: bit of the COB-id entry: the PDO does not exist
NO_REMOTE: Final = 0x4000_0000  #: bit of a TPDO's COB-id entry: no remote request allowed
_RECEIVE_COMMUNICATION: Final = 0x1400
_RECEIVE_MAPPING: Final = 0x1600
_TRANSMIT_COMMUNICATION: Final = 0x1800
_TRANSMIT_MAPPING: Final = 0x1A00


@dataclass(frozen=True)
class Pdo:
    """PDO ``number`` (from 1) of a node, sent to or by it under ``identifier``."""

    number: int
    transmit: bool  #: sent by the node
    identifier: int
    kind: int  #: transmission type
    entries: tuple[Entry, ...]
    timer_ms: int = 0  #: time-out of an RPDO, if the node has one

    def layout(self) -> struct.Struct:
        """Return the layout of the values in the frame.

        Raises:
            ValueError: more than the 8 bytes of a frame.

        """
        layout = struct.Struct("<" + "".join(entry.code for entry in self.entries))
        if layout.size > 8:
            raise ValueError(f"{self}: {layout.size} bytes do not fit a frame of 8")
        return layout

    def __str__(self) -> str:
        return f"{'TPDO' if self.transmit else 'RPDO'}{self.number}"

    @property
    def communication(self) -> int:
        """Index of the communication parameters."""
        first = _TRANSMIT_COMMUNICATION if self.transmit else _RECEIVE_COMMUNICATION
        return first + self.number - 1

    def cob_id(self) -> tuple[Entry, int]:
        """Return the COB-id entry, and its value while the PDO is valid."""
        entry = Entry(self.communication, 1, "I", f"COB-id of {self}")
        return entry, self.identifier | (NO_REMOTE if self.transmit else 0)

    def transmission(self) -> tuple[Entry, int]:
        """Return the transmission type."""
        return Entry(self.communication, 2, "B", f"transmission type of {self}"), self.kind

    def optional(self) -> Iterator[tuple[Entry, int]]:
        """Yield what not every node has: no inhibit time (0.1 ms), and the time-out (1 ms)."""
        if self.transmit:
            yield Entry(self.communication, 3, "H", f"inhibit time of {self}"), 0
        elif self.timer_ms:
            yield Entry(self.communication, 5, "H", f"event timer of {self}"), self.timer_ms

    def mapping(self) -> list[tuple[Entry, int]]:
        """Return the objects mapped, the number of them first."""
        index = (_TRANSMIT_MAPPING if self.transmit else _RECEIVE_MAPPING) + self.number - 1
        count = Entry(index, 0, "B", f"number of objects mapped to {self}")
        return [(count, len(self.entries))] + [
            (Entry(index, place, "I", f"object {place} mapped to {self}, {entry}"), mapped(entry))
            for place, entry in enumerate(self.entries, start=1)
        ]

    def remapping(self) -> Iterator[tuple[Entry, int]]:
        """Yield what changes the mapping, in this order: none, each, so many.

        A node refuses any other order (CiA 301, 7.5.2.36 and 7.5.2.38).
        """
        whole, *parts = self.mapping()
        yield whole[0], 0
        yield from parts
        yield whole

    def setup(self) -> Iterator[tuple[Entry, int]]:
        """Yield all that every node must take, in this order: switch off, map, switch on.

        Nothing but bit 31 of the COB-id may change while the PDO is valid (CiA 301, 7.5.2.35 and
        7.5.2.37).
        """
        valid, cob_id = self.cob_id()
        yield valid, cob_id | INVALID
        yield self.transmission()
        yield from self.remapping()
        yield valid, cob_id


def mapped(entry: Entry) -> int:
    """Return the value that maps ``entry``: index, sub-index and length in bits."""
    return entry.index << 16 | entry.sub << 8 | entry.size * 8
