"""Describes CAN frames in Linux's layout, and finds the CANopen service of an identifier.

Sources: linux/can.h and linux/can/error.h; CiA 301 (4.2.0), section 7.3.3, the predefined
connection set.
"""

from __future__ import annotations

import struct
from typing import Final

#: ``struct can_frame``: identifier with flags, length, 3 bytes of padding, 8 bytes of data.
CAN_FRAME: Final = struct.Struct("=IB3x8s")

EXTENDED: Final = 0x8000_0000  #: a 29-bit identifier
REMOTE: Final = 0x4000_0000  #: a remote transmission request
ERROR: Final = 0x2000_0000  #: no frame, a report of the controller

NMT: Final = 0x000
SYNC: Final = 0x080
EMCY: Final = 0x080  #: + node
TPDO: Final = (0x180, 0x280, 0x380, 0x480)  #: + node
RPDO: Final = (0x200, 0x300, 0x400, 0x500)  #: + node
SDO_REPLY: Final = 0x580  #: + node, server to client
SDO_REQUEST: Final = 0x600  #: + node, client to server
HEARTBEAT: Final = 0x700  #: + node

NODES: Final = range(1, 128)

_SERVICES: Final = (
    ("EMCY", EMCY), ("TPDO1", 0x180), ("RPDO1", 0x200), ("TPDO2", 0x280), ("RPDO2", 0x300),
    ("TPDO3", 0x380), ("RPDO3", 0x400), ("TPDO4", 0x480), ("RPDO4", 0x500),
    ("SDO reply", SDO_REPLY), ("SDO request", SDO_REQUEST), ("heartbeat", HEARTBEAT),
)  # fmt: skip

# linux/can/error.h: classes in the identifier, details in data[1] (controller) and data[2].
_BUS_OFF: Final = 0x040
_NO_ACK: Final = 0x020
_CONTROLLER: Final = 0x004
_CONTROLLER_OVERFLOW: Final = 0x01
_CONTROLLER_PASSIVE: Final = 0x30
DESTROYED: Final = 0x008  #: class of an error frame: a protocol violation on the wire
_PROTOCOL: Final = DESTROYED | 0x080
_RESTARTED: Final = 0x100


def pack(identifier: int, data: bytes) -> bytes:
    """Return the 16 bytes of a ``struct can_frame``; ``data`` has at most 8."""
    return CAN_FRAME.pack(identifier, len(data), data)


def unpack(packet: bytes) -> tuple[int, bytes]:
    """Return identifier (with its flags) and data of a ``struct can_frame``.

    Raises:
        ValueError: not 16 bytes, or a length beyond 8.

    """
    if len(packet) != CAN_FRAME.size:
        raise ValueError(f"a CAN frame has {CAN_FRAME.size} bytes, not {len(packet)}")
    identifier, length, data = CAN_FRAME.unpack(packet)
    if length > 8:
        raise ValueError(f"a CAN frame carries at most 8 bytes, not {length}")
    return identifier, data[:length]


def describe(identifier: int) -> str:
    """Return what a person calls an identifier: ``0x181 (TPDO1 of node 1)``."""
    if identifier & EXTENDED:
        return f"0x{identifier & 0x1FFF_FFFF:08X} (29 bits, not CANopen)"
    if identifier == NMT:
        return "0x000 (NMT command)"
    if identifier == SYNC:
        return "0x080 (SYNC)"
    for name, base in _SERVICES:
        if identifier - base in NODES:
            return f"0x{identifier:03X} ({name} of node {identifier - base})"
    return f"0x{identifier:03X}"


def is_bus_off(identifier: int) -> bool:
    """Return whether an error frame reports that the controller is off the bus."""
    return bool(identifier & _BUS_OFF)


def is_only_news(identifier: int, data: bytes) -> bool:
    """Return whether an error frame reports no error on the wire.

    That is: the controller is back on the bus, or frames were lost behind it.
    """
    if identifier & (_BUS_OFF | _NO_ACK | _PROTOCOL):
        return False
    return not identifier & _CONTROLLER or _detail(data) == _CONTROLLER_OVERFLOW


def is_overflow(identifier: int, data: bytes) -> bool:
    """Return whether an error frame reports that frames were lost unread in the controller."""
    return bool(identifier & _CONTROLLER and _detail(data) & _CONTROLLER_OVERFLOW)


def _detail(data: bytes) -> int:
    return data[1] if len(data) > 1 else 0


def describe_error(identifier: int, data: bytes) -> str:
    """Return in words what an error frame reports."""
    detail = _detail(data)
    words = [
        text
        for applies, text in (
            (identifier & _BUS_OFF, "bus-off: the controller has left the bus"),
            (identifier & _NO_ACK, "no node acknowledges"),
            (identifier & _PROTOCOL, "frames are destroyed"),
            (identifier & _CONTROLLER and detail & _CONTROLLER_OVERFLOW, "receive overflow"),
            (identifier & _CONTROLLER and detail & _CONTROLLER_PASSIVE, "error passive"),
            (identifier & _RESTARTED, "controller restarted"),
        )
        if applies
    ]
    return ", ".join(words) or f"error class 0x{identifier & 0x1FFF_FFFF:X}"
