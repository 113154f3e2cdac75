"""Defines the states of a CiA 402 drive, and the controlwords that change the state.

Source: CiA 402-2, sections "Statusword" and "Finite state automaton" (table of the bits by state,
table of the commands).
"""

from __future__ import annotations

from enum import Enum, IntEnum
from typing import Final


class DriveState(Enum):
    """States of the automaton, in the words of the standard."""

    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    ENABLED = "operation enabled"
    QUICK_STOP = "quick stop active"
    FAULT_REACTION = "fault reaction active"
    FAULT = "fault"
    UNKNOWN = "none of the standard"


class Mode(IntEnum):
    """Modes of operation (6060h); bit ``mode - 1`` of 6502h is set if a drive has it."""

    PROFILE_VELOCITY = 3
    PROFILE_TORQUE = 4
    HOMING = 6
    CYCLIC_VELOCITY = 9
    CYCLIC_TORQUE = 10

    @property
    def title(self) -> str:
        """Name of the mode in words."""
        return self.name.lower().replace("_", " ")


#: (mask, bits under it) of the statusword -> state.
_STATES: Final = (
    (0x4F, 0x00, DriveState.NOT_READY),
    (0x4F, 0x40, DriveState.SWITCH_ON_DISABLED),
    (0x6F, 0x21, DriveState.READY),
    (0x6F, 0x23, DriveState.SWITCHED_ON),
    (0x6F, 0x27, DriveState.ENABLED),
    (0x6F, 0x07, DriveState.QUICK_STOP),
    (0x4F, 0x0F, DriveState.FAULT_REACTION),
    (0x4F, 0x08, DriveState.FAULT),
)

# Bits of the statusword.
VOLTAGE: Final = 0x0010  #: the power stage is supplied
REMOTE: Final = 0x0200  #: the drive follows the controlword
FOLLOWS: Final = 0x1000  #: in the cyclic modes: the drive follows the target
HOMED: Final = 0x1000  #: in the homing mode: homing attained
HOMING_ERROR: Final = 0x2000  #: in the homing mode

# Controlwords.
DISABLE_VOLTAGE: Final = 0x00
SHUTDOWN: Final = 0x06
SWITCH_ON: Final = 0x07
ENABLE: Final = 0x0F
FAULT_RESET: Final = 0x80  #: acts on its rising edge
START_HOMING: Final = 0x10  #: in the homing mode, beside ENABLE; acts on its rising edge
#: All that are written.
WORDS: Final = (DISABLE_VOLTAGE, FAULT_RESET, SHUTDOWN, SWITCH_ON, ENABLE)

_TOWARDS_ENABLED: Final = {
    DriveState.SWITCH_ON_DISABLED: SHUTDOWN,  # transition 2
    DriveState.READY: SWITCH_ON,  # 3
    DriveState.SWITCHED_ON: ENABLE,  # 4
    DriveState.ENABLED: ENABLE,
    DriveState.QUICK_STOP: DISABLE_VOLTAGE,  # 12
}


def state_of(statusword: int) -> DriveState:
    """Return the state in a statusword."""
    for mask, bits, state in _STATES:
        if statusword & mask == bits:
            return state
    return DriveState.UNKNOWN


class Enabling:
    """Leads a drive to operation enabled, one controlword per cycle.

    A fault is reset by a rising bit 7; every level is held for ``HOLD`` cycles, since a drive may
    read its controlword less often than it gets one.
    """

    HOLD: Final = 4

    def __init__(self) -> None:
        self._in_fault = 0

    def next(self, statusword: int) -> int:
        """Return the controlword that answers ``statusword``."""
        state = state_of(statusword)
        if state is DriveState.FAULT:
            self._in_fault += 1
            return FAULT_RESET if self._in_fault // self.HOLD % 2 else DISABLE_VOLTAGE
        self._in_fault = 0
        return _TOWARDS_ENABLED.get(state, DISABLE_VOLTAGE)
