"""Defines entries of a CANopen object dictionary: index, type, and how a value is packed.

Sources: CiA 301, section 7.5 (1000h range); CiA 402-2 and -3 (6000h range of drives); CiA 406
(6000h range of encoders); CiA 404
(6100h and 7100h ranges of measuring devices); maxon EPOS4 Firmware Specification (3001h).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Entry:
    """One entry: index, sub-index, its type as :mod:`struct` writes it, and its name."""

    index: int
    sub: int
    code: str
    name: str

    def __str__(self) -> str:
        return f"{self.index:04X}:{self.sub:02X} ({self.name})"

    @property
    def size(self) -> int:
        """Bytes of the value."""
        return struct.calcsize("<" + self.code)

    def pack(self, value: int) -> bytes:
        """Return ``value`` as the dictionary holds it.

        Raises:
            ValueError: it does not fit the type.

        """
        try:
            return struct.pack("<" + self.code, value)
        except struct.error as error:
            raise ValueError(f"{value} does not fit object {self}: {error}") from error

    def unpack(self, data: bytes) -> int:
        """Return the value in ``data``.

        Raises:
            ValueError: of another size than the type.

        """
        if len(data) != self.size:
            raise ValueError(f"object {self} has {len(data)} bytes, expected {self.size}")
        return int(struct.unpack("<" + self.code, data)[0])


DEVICE_TYPE: Final = Entry(0x1000, 0, "I", "device type")
ERROR_REGISTER: Final = Entry(0x1001, 0, "B", "error register")
LAST_ERROR: Final = Entry(0x1003, 1, "I", "error history")
HEARTBEAT_CONSUMER: Final = Entry(0x1016, 1, "I", "consumer heartbeat time")
HEARTBEAT_PRODUCER: Final = Entry(0x1017, 0, "H", "producer heartbeat time")
VENDOR: Final = Entry(0x1018, 1, "I", "vendor id")
PRODUCT: Final = Entry(0x1018, 2, "I", "product code")
REVISION: Final = Entry(0x1018, 3, "I", "revision number")
SERIAL: Final = Entry(0x1018, 4, "I", "serial number")
DEVICE_NAME: Final = (0x1008, 0)  #: text of any length

# CiA 402
ABORT_CONNECTION_OPTION: Final = Entry(0x6007, 0, "h", "abort connection option code")
CONTROLWORD: Final = Entry(0x6040, 0, "H", "controlword")
STATUSWORD: Final = Entry(0x6041, 0, "H", "statusword")
MODE: Final = Entry(0x6060, 0, "b", "modes of operation")
MODE_DISPLAY: Final = Entry(0x6061, 0, "b", "modes of operation display")
POSITION: Final = Entry(0x6064, 0, "i", "position actual value")
POSITION_LOW: Final = Entry(0x607B, 1, "i", "min position range limit")
POSITION_HIGH: Final = Entry(0x607B, 2, "i", "max position range limit")
VELOCITY: Final = Entry(0x606C, 0, "i", "velocity actual value")
TARGET_TORQUE: Final = Entry(0x6071, 0, "h", "target torque")
MAX_TORQUE: Final = Entry(0x6072, 0, "H", "max torque")
MAX_CURRENT: Final = Entry(0x6073, 0, "H", "max current")
RATED_CURRENT: Final = Entry(0x6075, 0, "I", "motor rated current")
RATED_TORQUE: Final = Entry(0x6076, 0, "I", "motor rated torque")
TORQUE: Final = Entry(0x6077, 0, "h", "torque actual value")
CURRENT: Final = Entry(0x6078, 0, "h", "current actual value")
VELOCITY_UNIT: Final = Entry(0x60A9, 0, "I", "SI unit velocity")
OUTPUTS: Final = Entry(0x60FE, 1, "I", "digital outputs")
OUTPUTS_MASK: Final = Entry(0x60FE, 2, "I", "digital outputs, bit mask")
TARGET_VELOCITY: Final = Entry(0x60FF, 0, "i", "target velocity")
HOMING_METHOD: Final = Entry(0x6098, 0, "b", "homing method")
SUPPORTED_MODES: Final = Entry(0x6502, 0, "I", "supported drive modes")

# maxon EPOS4
NOMINAL_CURRENT: Final = Entry(0x3001, 1, "I", "nominal current")
CURRENT_LIMIT: Final = Entry(0x3001, 2, "I", "output current limit")
TORQUE_CONSTANT: Final = Entry(0x3001, 5, "I", "motor torque constant")

# CiA 406
OPERATING_PARAMETERS: Final = Entry(0x6000, 0, "H", "operating parameters")
UNITS_PER_REVOLUTION: Final = Entry(0x6001, 0, "I", "measuring units per revolution")
MEASURING_RANGE: Final = Entry(0x6002, 0, "I", "total measuring range")
PRESET: Final = Entry(0x6003, 0, "I", "preset value")
ENCODER_POSITION: Final = Entry(0x6004, 0, "I", "position value")
LINEAR_STEP: Final = Entry(0x6005, 1, "I", "position step of a linear encoder")
LINEAR_PRESET: Final = Entry(0x6010, 1, "i", "preset value of channel 1")
LINEAR_POSITION: Final = Entry(0x6020, 1, "i", "position value of channel 1")
OPERATING_STATUS: Final = Entry(0x6500, 0, "H", "operating status")
STEPS_PER_REVOLUTION: Final = Entry(0x6501, 0, "I", "single-turn resolution")
REVOLUTIONS: Final = Entry(0x6502, 0, "H", "number of distinguishable revolutions")

# CiA 404, channel 1
AUTOZERO: Final = Entry(0x6125, 1, "I", "autozero")
PHYSICAL_UNIT: Final = Entry(0x6131, 1, "I", "physical unit of the process value")
DECIMAL_DIGITS: Final = Entry(0x6132, 1, "B", "decimal digits of the process value")
MEASURED_STATUS: Final = Entry(0x6150, 1, "B", "status of the measurement")
PROCESS_VALUE: Final = Entry(0x7130, 1, "h", "process value")
