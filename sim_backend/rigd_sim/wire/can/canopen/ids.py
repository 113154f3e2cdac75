"""Defines the constants of CiA 301 that simulated nodes share, and the identity of a node."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

#: COB-IDs of the predefined connection set (CiA 301, table 50); a node adds its own id.
NMT_COMMAND: Final = 0x000
SYNC: Final = 0x080
EMERGENCY: Final = 0x080
TPDO1: Final = 0x180
RPDO1: Final = 0x200
SDO_ANSWER: Final = 0x580
SDO_REQUEST: Final = 0x600
HEARTBEAT: Final = 0x700
#: From one PDO of a node to its next.
NEXT_PDO: Final = 0x100
#: PDOs of either direction.
PDOS: Final = 4

HEARTBEAT_LOST: Final = 0x8130
PDO_TOO_SHORT: Final = 0x8210
PDO_LATE: Final = 0x8250
#: Values of object 1029:1: what a node does in the operational state when it loses its master.
NO_CHANGE: Final = 1
TO_STOPPED: Final = 2
#: Unit of the inhibit time, object 1800:3, in ns.
INHIBIT_NS: Final = 100_000
#: From reset to the boot-up message, in s.
BOOT_S: Final = 0.02


class Nmt(IntEnum):
    """NMT states with the numbers that heartbeats carry (CiA 301, 7.2.8.3.2.2)."""

    BOOT = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


@dataclass(frozen=True)
class Identity:
    """The identity that a node reports: objects 1000, 1008, 1018."""

    device_type: int
    name: str
    product: int
    serial: int
    vendor: int = 0x52494744  #: no vendor has this number: a simulation never passes for a product
    revision: int = 0x00010000


@dataclass(frozen=True)
class Manners:
    """What a node may do by CiA 301 beside what every node does."""

    boots_twice: bool = False  #: sends its boot-up message twice
    boot_emergencies: tuple[int, ...] = ()  #: codes that it sends after boot-up
    segmented: bool = False  #: answers short SDO uploads in segments, too
