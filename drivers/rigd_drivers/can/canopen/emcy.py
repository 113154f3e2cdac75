"""Decodes the emergency messages of CANopen devices to text.

Sources: CiA 301 (4.2.0), sections 7.2.7 and 7.5.2.2 (error register); CiA 402-2, table of error
codes; the maxon EPOS4 Firmware Specification names 0x7305 and others the same way.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

_EMCY: Final = struct.Struct("<HB5s")

#: Meaning of single codes, before their class.
TEXTS: Final = {
    0x0000: "error reset, no error",
    0x1000: "generic error",
    0x2310: "overcurrent at the output",
    0x2320: "short circuit at the output",
    0x3110: "mains overvoltage",
    0x3210: "supply overvoltage",
    0x3220: "supply undervoltage",
    0x4210: "overtemperature of the power stage",
    0x4310: "overtemperature of the drive",
    0x5112: "undervoltage of the logic supply",
    0x5280: "hardware fault",
    0x6080: "internal software fault",
    0x6320: "parameters are inconsistent",
    0x7121: "motor blocked",
    0x7300: "sensor error",
    0x7305: "encoder 1 error",
    0x7306: "encoder 2 error",
    0x7320: "position sensor breach",
    0x8110: "CAN overrun, frames lost",
    0x8120: "CAN in error-passive mode",
    0x8130: "heartbeat of the master lost",
    0x8140: "recovered from bus-off",
    0x8150: "two nodes send the same identifier",
    0x8180: "CAN clock failure",
    0x8210: "a PDO was too short and not processed",
    0x8220: "a PDO was too long",
    0x8250: "RPDO timed out",
    0x8280: "SYNC has an unexpected length",
    0x8400: "velocity deviates too far from its target",
    0x8611: "position deviates too far from its target",
    0x8A80: "negative limit switch",
    0x8A81: "positive limit switch",
    0x9080: "interlock (safe torque off) active",
}
#: What the upper byte, or the upper nibble, of any other code means.
_CLASSES: Final = {
    0x10: "generic error", 0x20: "current", 0x21: "current at the input",
    0x22: "current inside the device", 0x23: "current at the output", 0x30: "voltage",
    0x31: "mains voltage", 0x32: "voltage inside the device", 0x33: "output voltage",
    0x40: "temperature", 0x41: "ambient temperature", 0x42: "device temperature",
    0x43: "drive temperature", 0x50: "device hardware", 0x60: "device software",
    0x61: "internal software", 0x62: "user software", 0x63: "data set",
    0x70: "additional modules", 0x71: "power module", 0x73: "sensor", 0x80: "monitoring",
    0x81: "communication", 0x82: "protocol", 0x83: "torque control", 0x84: "velocity control",
    0x85: "position control", 0x86: "positioning", 0x90: "external error",
    0xF0: "additional functions", 0xFF: "device specific",
}  # fmt: skip
_REGISTER: Final = (
    "generic", "current", "voltage", "temperature", "communication", "device profile",
    "reserved", "manufacturer specific",
)  # fmt: skip

HEARTBEAT_LOST: Final = 0x8130
RPDO_TIMED_OUT: Final = 0x8250
#: What a node reports because its master fell silent.
MASTER_SILENT: Final = frozenset({HEARTBEAT_LOST, RPDO_TIMED_OUT})


@dataclass(frozen=True)
class Emergency:
    """An emergency: its code, the error register (1001h) and 5 bytes of the manufacturer."""

    code: int
    register: int
    details: bytes

    @property
    def is_reset(self) -> bool:
        """Whether it reports that errors are gone."""
        return self.code & 0xFF00 == 0

    def __str__(self) -> str:
        text = f"emergency {describe(self.code)}"
        if self.register:
            text += f" (error register: {causes(self.register)})"
        if any(self.details):
            text += f" [{self.details.hex(' ')}]"
        return text


def decode(data: bytes) -> Emergency | None:
    """Return the emergency in a frame; None if the frame does not have 8 bytes."""
    if len(data) != _EMCY.size:
        return None
    return Emergency(*_EMCY.unpack(data))


def causes(register: int) -> str:
    """Return the names of the bits of an error register (object 1001)."""
    return ", ".join(name for bit, name in enumerate(_REGISTER) if register >> bit & 1)


def describe(code: int) -> str:
    """Return an error code in words, such as ``0x2310 (overcurrent at the output)``."""
    text = TEXTS.get(code) or _CLASSES.get(code >> 8) or _CLASSES.get(code >> 8 & 0xF0)
    return f"0x{code:04X} ({text or 'not in the standard'})"
