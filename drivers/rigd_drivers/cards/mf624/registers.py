"""Lists the registers of the Humusoft MF624: addresses, bits and codes; the module does no I/O.

Sources: MF 624 User's Manual (Humusoft), register tables; hudaqlib 2007 of the same maker; the
Linux drivers ``uio_mf624`` and ``mf6x4``. The manual numbers the memory regions 0, 1, 2. In the
hardware these regions are BAR0, BAR2 and BAR4, and this module uses the hardware's numbers.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

PCI_VENDOR: Final = 0x186C
PCI_DEVICE: Final = 0x0624
UIO_NAME: Final = "mf624"
BARS: Final = (0, 2, 4)  #: in the order of the maps of ``uio_mf624``

ANALOG_INPUTS: Final = 8
ANALOG_OUTPUTS: Final = 8
ENCODERS: Final = 4
LINES: Final = 8  #: digital inputs, and as many outputs

#: A register: (BAR, offset). One address may be two registers, one to read and one to write.
Register = tuple[int, int]

INTCSR: Final[Register] = (0, 0x4C)  #: 32 bit; 0 written disables all interrupts
GPIOC: Final[Register] = (0, 0x54)  #: 32 bit
ADDATA: Final[Register] = (2, 0x00)  #: 16 bit, read: pops the FIFO of converted inputs
ADCTRL: Final[Register] = (2, 0x00)  #: 16 bit, written: inputs to convert, a bit each
DIN: Final[Register] = (2, 0x10)  #: 16 bit, read
DOUT: Final[Register] = (2, 0x10)  #: 16 bit, written
ADSTART: Final[Register] = (2, 0x20)  #: 16 bit; reading it starts the conversion
IRCSTATUS: Final[Register] = (4, 0x6C)  #: 32 bit, read: a byte for each encoder
IRCCTRL: Final[Register] = (4, 0x6C)  #: 32 bit, written: a byte for each encoder

#: The bits of GPIOC that configure the card's own bridge; always written so.
GPIOC_BASE: Final = 0x024006C0
EOLC: Final = 1 << 17  #: during a conversion
LDAC: Final = 1 << 23  #: outputs hold; at its falling edge all take their new codes together
DACEN: Final = 1 << 26  #: outputs drive; otherwise they are tied to ground

#: What an absent PCI device reads as: no card pulls the bus low.
ABSENT: Final = 0xFFFF_FFFF

#: Depth of the FIFO of converted inputs.
FIFO_WORDS: Final = 8

ZERO_VOLTS: Final = 0x2000
_HIGHEST_CODE: Final = 0x3FFF
_VOLTS_PER_CODE: Final = 20.0 / 0x4000
LOWEST_VOLTS: Final = -10.0
HIGHEST_VOLTS: Final = 10.0 - _VOLTS_PER_CODE

#: Bit 7 of an encoder's byte in IRCCTRL: digital filter; mode 0 is quadrature, counting freely.
IRC_FILTER: Final = 0x80


def da(output: int) -> Register:
    """Return the 16-bit register of an analogue output; write only."""
    return (2, 0x20 + 2 * output)


def irc(encoder: int) -> Register:
    """Return the 32-bit register of an encoder's count; read only."""
    return (4, 0x70 + 4 * encoder)


def volts_of(word: int) -> float:
    """Return the volts of a word from ADDATA: 14 bits, two's complement, +-10 V.

    The upper two bits of the word are not defined and not looked at.
    """
    code = word & _HIGHEST_CODE
    return (code - 0x4000 if code & 0x2000 else code) * _VOLTS_PER_CODE


def code_of(volts: float) -> int:
    """Return the code of an analogue output: 14 bits, offset binary, clipped to +-10 V."""
    return min(max(round((volts + 10.0) / _VOLTS_PER_CODE), 0), _HIGHEST_CODE)


def mask_of(bits: Iterable[int]) -> int:
    """Return the word with these bits set."""
    word = 0
    for bit in bits:
        word |= 1 << bit
    return word


def irc_control(*, filtered: bool) -> int:
    """Return IRCCTRL for four encoders that count freely in quadrature."""
    return (IRC_FILTER if filtered else 0) * 0x01010101


def index_bits(status: int) -> int:
    """Return the index signals of the encoders, a bit each, from IRCSTATUS.

    Taken to be bit 0 of each encoder's byte, as IRCCTRL has its byte too; not yet seen on a
    real card.
    """
    return mask_of(encoder for encoder in range(ENCODERS) if status >> (8 * encoder) & 1)
