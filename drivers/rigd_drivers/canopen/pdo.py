"""Packs entries into process data objects (PDOs), and configures the PDO mapping of a node.

Source: CiA 301 (4.2.0), sections 7.5.2.35 to 7.5.2.38.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from rigd_drivers.canopen.objects import Entry

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

    def setup(self) -> Iterator[tuple[Entry, int]]:
        """Yield what must be written, in this order: switch off, map, switch on.

        A node refuses a mapping that is changed in any other order (abort 0x08000022).
        """
        mapping = (_TRANSMIT_MAPPING if self.transmit else _RECEIVE_MAPPING) + self.number - 1
        cob_id = self.identifier | (NO_REMOTE if self.transmit else 0)
        valid = Entry(self.communication, 1, "I", f"COB-id of {self}")
        count = Entry(mapping, 0, "B", f"number of objects mapped to {self}")
        yield valid, cob_id | INVALID
        yield Entry(self.communication, 2, "B", f"transmission type of {self}"), self.kind
        yield count, 0
        for position, entry in enumerate(self.entries, start=1):
            where = Entry(mapping, position, "I", f"object {position} mapped to {self}, {entry}")
            yield where, mapped(entry)
        yield count, len(self.entries)
        yield valid, cob_id

    def inhibit_time(self) -> Entry:
        """Return the entry of the time between two, in 0.1 ms; only of TPDOs, optional."""
        return Entry(self.communication, 3, "H", f"inhibit time of {self}")

    def event_timer(self) -> Entry:
        """Return the entry of the time-out of an RPDO, in ms; optional."""
        return Entry(self.communication, 5, "H", f"event timer of {self}")


def mapped(entry: Entry) -> int:
    """Return the value that maps ``entry``: index, sub-index and length in bits."""
    return entry.index << 16 | entry.sub << 8 | entry.size * 8
