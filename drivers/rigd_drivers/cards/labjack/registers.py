"""Names the registers of LabJack's T series that rigd uses, and packs them into packets.

Source: the Modbus map of the T series as LabJack publishes it (``ljm_constants.json``,
2025.12.18), and "Protocol Details [Direct Modbus TCP]" for function 76, Modbus Feedback: a packet
of frames, each of a type (0 read, 1 write), an address and a count of registers, after which
a write has its data. The answer has the data of all reads, one after the other.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

#: Modbus Feedback, LabJack's own function.
FEEDBACK: Final = 76
_READ, _WRITE = 0, 1
_UINT16, _UINT32, _FLOAT32 = "H", "I", "f"
#: Digital lines: FIO0 to 7 are 0 to 7, EIO0 to 7 are 8 to 15, CIO0 to 3 are 16 to 19, MIO 20 to 22.
ALL_LINES: Final = (1 << 23) - 1


@dataclass(frozen=True, slots=True)
class Register:
    """One value of the device: its name, address of its first register, and type."""

    name: str
    address: int
    kind: str

    @property
    def count(self) -> int:
        """Registers of 16 bits that it takes."""
        return struct.calcsize(f">{self.kind}") // 2


@dataclass(frozen=True, slots=True)
class Write:
    """A value for a register."""

    register: Register
    value: float


@dataclass(frozen=True, eq=False)
class Packet:
    """One request of function 76 and the layout of its answer."""

    data: bytes  #: frames, without the function
    answer: struct.Struct
    names: tuple[str, ...]  #: of the register of each frame


def packet(*frames: Register | Write) -> Packet:
    """Return the request that reads and writes these in this order."""
    data = bytearray()
    kinds = ">"
    names = []
    for frame in frames:
        if isinstance(frame, Register):
            data += struct.pack(">BHB", _READ, frame.address, frame.count)
            kinds += frame.kind
            names.append(frame.name)
        else:
            register = frame.register
            value = frame.value if register.kind == _FLOAT32 else int(frame.value)
            data += struct.pack(
                f">BHB{register.kind}", _WRITE, register.address, register.count, value
            )
            names.append(register.name)
    return Packet(bytes(data), struct.Struct(kinds), tuple(names))


def bits(lines: Sequence[int]) -> int:
    """Return these lines, one bit each."""
    return sum(1 << line for line in set(lines))


def ain(number: int) -> Register:
    """Volts of an analogue input."""
    return Register(f"AIN{number}", 2 * number, _FLOAT32)


def ain_range(number: int) -> Register:
    """Range of an analogue input in V."""
    return Register(f"AIN{number}_RANGE", 40000 + 2 * number, _FLOAT32)


def ain_negative(number: int) -> Register:
    """Negative channel of an analogue input; 199: it is single-ended."""
    return Register(f"AIN{number}_NEGATIVE_CH", 41000 + number, _UINT16)


def ain_resolution(number: int) -> Register:
    """Resolution index of an analogue input."""
    return Register(f"AIN{number}_RESOLUTION_INDEX", 41500 + number, _UINT16)


def dac(number: int) -> Register:
    """Volts of an analogue output of the device itself."""
    return Register(f"DAC{number}", 1000 + 2 * number, _FLOAT32)


def tdac(number: int) -> Register:
    """Volts of an output of an LJTick-DAC; an even number is its DACA."""
    return Register(f"TDAC{number}", 30000 + 2 * number, _FLOAT32)


def counted(line: int) -> Register:
    """Count of the extended feature on a line."""
    return Register(f"DIO{line}_EF_READ_A", 3000 + 2 * line, _UINT32)


def feature_enable(line: int) -> Register:
    """Whether the extended feature of a line runs."""
    return Register(f"DIO{line}_EF_ENABLE", 44000 + 2 * line, _UINT32)


def feature_index(line: int) -> Register:
    """Which extended feature a line has."""
    return Register(f"DIO{line}_EF_INDEX", 44100 + 2 * line, _UINT32)


QUADRATURE: Final = 10
INTERRUPT_COUNTER: Final = 8
SINGLE_ENDED: Final = 199

DIO_STATE: Final = Register("DIO_STATE", 2800, _UINT32)
DIO_DIRECTION: Final = Register("DIO_DIRECTION", 2850, _UINT32)
DIO_ANALOG_ENABLE: Final = Register("DIO_ANALOG_ENABLE", 2880, _UINT32)
#: Lines that writes to the three above leave alone.
DIO_INHIBIT: Final = Register("DIO_INHIBIT", 2900, _UINT32)
LAST_ERROR: Final = Register("LAST_ERR_DETAIL", 55000, _UINT16)
PRODUCT_ID: Final = Register("PRODUCT_ID", 60000, _FLOAT32)
FIRMWARE_VERSION: Final = Register("FIRMWARE_VERSION", 60004, _FLOAT32)
SERIAL_NUMBER: Final = Register("SERIAL_NUMBER", 60028, _UINT32)

WATCHDOG_ENABLE: Final = Register("WATCHDOG_ENABLE_DEFAULT", 61600, _UINT32)
WATCHDOG_ADVANCED: Final = Register("WATCHDOG_ADVANCED_DEFAULT", 61602, _UINT32)
WATCHDOG_TIMEOUT_S: Final = Register("WATCHDOG_TIMEOUT_S_DEFAULT", 61604, _UINT32)
WATCHDOG_STARTUP_DELAY_S: Final = Register("WATCHDOG_STARTUP_DELAY_S_DEFAULT", 61606, _UINT32)
WATCHDOG_STRICT: Final = Register("WATCHDOG_STRICT_ENABLE_DEFAULT", 61610, _UINT32)
WATCHDOG_KEY: Final = Register("WATCHDOG_STRICT_KEY_DEFAULT", 61612, _UINT32)
WATCHDOG_CLEAR: Final = Register("WATCHDOG_STRICT_CLEAR", 61614, _UINT32)
WATCHDOG_RESET: Final = Register("WATCHDOG_RESET_ENABLE_DEFAULT", 61620, _UINT32)
WATCHDOG_DIO: Final = Register("WATCHDOG_DIO_ENABLE_DEFAULT", 61630, _UINT32)
WATCHDOG_DIO_STATE: Final = Register("WATCHDOG_DIO_STATE_DEFAULT", 61632, _UINT32)
WATCHDOG_DIO_DIRECTION: Final = Register("WATCHDOG_DIO_DIRECTION_DEFAULT", 61634, _UINT32)
WATCHDOG_DIO_INHIBIT: Final = Register("WATCHDOG_DIO_INHIBIT_DEFAULT", 61636, _UINT32)


def watchdog_dac_enable(number: int) -> Register:
    """Whether the watchdog sets an analogue output of the device."""
    return Register(f"WATCHDOG_DAC{number}_ENABLE_DEFAULT", 61640 + 10 * number, _UINT32)


def watchdog_dac(number: int) -> Register:
    """To how many V it sets it."""
    return Register(f"WATCHDOG_DAC{number}_DEFAULT", 61642 + 10 * number, _FLOAT32)
