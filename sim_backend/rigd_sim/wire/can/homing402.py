"""Simulates the homing mode of a CiA 402 drive that stands: methods 35 and 37; no I/O.

Source: CiA 402-2, homing mode: it begins with the rising edge of bit 4 of the controlword while the
drive is enabled; bit 12 of the statusword shows that it is done, bit 13 an error.
"""

from __future__ import annotations

from typing import Final

#: Bit of the controlword.
START: Final = 1 << 4
#: Bits of the statusword: target reached, homing attained, homing error.
REACHED: Final = 1 << 10
ATTAINED: Final = 1 << 12
ERROR: Final = 1 << 13
#: Methods that take the present position for that of the home offset.
IN_PLACE: Final = (35, 37)


class Homing:
    """What a drive adds to its position, and how far its homing has come."""

    def __init__(self) -> None:
        self.offset = 0  #: counts to be added to those of the motor
        self.status = 0  #: bits of the statusword in this mode
        self._started = False

    def follow(self, word: int, method: int, counts: int, *, enabled: bool) -> None:
        """Follow a controlword in the homing mode; ``counts`` are those of the motor."""
        start = bool(word & START) and enabled
        if start and not self._started:
            if method in IN_PLACE:
                self.offset, self.status = -counts, ATTAINED | REACHED
            else:
                self.status = ERROR
        self._started = start

    def power_off(self) -> None:
        """Forget: the position of an incremental encoder begins anew."""
        self.offset = self.status = 0
        self._started = False
