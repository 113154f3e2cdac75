"""Makes the emergency messages of a simulated CANopen node, and keeps its error objects.

Source: CiA 301, 7.2.7 and 7.5.2.2 to 7.5.2.4.
"""

from __future__ import annotations

import struct
from typing import Final

from rigd_sim.wire.can.canopen.dictionary import Abort, AbortCode, Dictionary, Entry, Kind

#: Code, error register, manufacturer's own.
EMERGENCY: Final = struct.Struct("<HB5s")
NO_ERROR: Final = 0x0000
#: Errors that the history keeps.
DEPTH: Final = 8
#: Bits of the error register by the class of the code (CiA 301, tables 26 and 42).
GENERIC: Final = 0x01
CLASSES: Final = {0x2: 0x02, 0x3: 0x04, 0x4: 0x08, 0x8: 0x10, 0xF: 0x80}


class Errors:
    """Error register 1001, history 1003, and the messages that report errors."""

    def __init__(self, dictionary: Dictionary) -> None:
        self._register = dictionary.add(Entry(0x1001, 0, Kind.U8, 0, mappable=True))
        self._history = dictionary.array(
            0x1003, [Entry(0x1003, sub, Kind.U32, 0) for sub in range(1, DEPTH + 1)]
        )
        self._count = dictionary.find(0x1003, 0)
        self._count.value = self._count.default = 0
        self._count.writable = True
        self._count.check = _only_zero
        self._count.changed = self._forget

    def report(self, code: int) -> bytes:
        """Note an error; return the emergency message that reports it."""
        self._register.value |= GENERIC | CLASSES.get(code >> 12, 0)
        for newer, older in zip(self._history[-2::-1], self._history[:0:-1], strict=True):
            older.value = newer.value
        self._history[0].value = code
        self._count.value = min(self._count.value + 1, DEPTH)
        return EMERGENCY.pack(code, self._register.value, b"")

    def over(self) -> bytes:
        """Clear the register; return the message that reports that no error is left."""
        self._register.value = 0
        return EMERGENCY.pack(NO_ERROR, 0, b"")

    def _forget(self, _: int) -> None:
        for entry in self._history:
            entry.value = 0


def _only_zero(value: int) -> None:
    if value:
        raise Abort(AbortCode.VALUE_RANGE)
