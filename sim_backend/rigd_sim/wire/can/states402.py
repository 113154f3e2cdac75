"""Simulates the state machine of a CiA 402 drive; the module does no I/O.

Sources: CiA 402-2, 6; IEC 61800-7-201, 6.3.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final


class DriveState(IntEnum):
    """States with the bits 0 to 3, 5 and 6 of the statusword that show them."""

    SWITCH_ON_DISABLED = 0x40
    READY_TO_SWITCH_ON = 0x21
    SWITCHED_ON = 0x23
    OPERATION_ENABLED = 0x27
    QUICK_STOP_ACTIVE = 0x07
    FAULT = 0x08


#: Bits of the controlword.
SWITCH_ON: Final = 0x01
ENABLE_VOLTAGE: Final = 0x02
NO_QUICK_STOP: Final = 0x04
ENABLE_OPERATION: Final = 0x08
FAULT_RESET: Final = 0x80

#: Bits of the statusword beside the state.
VOLTAGE_ENABLED: Final = 1 << 4
REMOTE: Final = 1 << 9
LIMITED: Final = 1 << 11
FOLLOWS: Final = 1 << 12

_S = DriveState
#: States in which the power stage may be commanded off, and those that quick stop leaves.
_ON: Final = (_S.READY_TO_SWITCH_ON, _S.SWITCHED_ON, _S.OPERATION_ENABLED, _S.QUICK_STOP_ACTIVE)
_SHUTDOWN: Final = (_S.SWITCH_ON_DISABLED, _S.SWITCHED_ON, _S.OPERATION_ENABLED)
_SWITCH_ON: Final = (_S.READY_TO_SWITCH_ON, _S.OPERATION_ENABLED)
_ENABLE: Final = (_S.READY_TO_SWITCH_ON, _S.SWITCHED_ON)


class StateMachine:
    """Follows the controlword; a fault leads to ``FAULT`` at once."""

    def __init__(self) -> None:
        self.state = DriveState.SWITCH_ON_DISABLED
        self._last = 0

    def power_on(self) -> None:
        """Start again, as after a reset."""
        self.state = DriveState.SWITCH_ON_DISABLED
        self._last = 0

    def fail(self) -> None:
        """Enter the fault state (transitions 13 and 14)."""
        self.state = DriveState.FAULT

    def switch_off(self) -> None:
        """Leave every state with power (transitions 9, 10, 12); a fault stays one."""
        if self.state in _ON:
            self.state = DriveState.SWITCH_ON_DISABLED

    def quick_stop(self) -> None:
        """Begin a quick stop if the drive is enabled (transition 11)."""
        if self.state is DriveState.OPERATION_ENABLED:
            self.state = DriveState.QUICK_STOP_ACTIVE

    def control(self, word: int) -> bool:
        """Follow a controlword; return whether it asks to reset faults (transition 15)."""
        reset = bool(word & ~self._last & FAULT_RESET)
        self._last = word
        if self.state is DriveState.FAULT:
            if reset:
                self.state = DriveState.SWITCH_ON_DISABLED
            return reset
        if not word & ENABLE_VOLTAGE:
            self.switch_off()
        elif not word & NO_QUICK_STOP:
            if self.state is DriveState.OPERATION_ENABLED:
                self.quick_stop()
            elif self.state is not DriveState.QUICK_STOP_ACTIVE:
                self.switch_off()
        elif not word & SWITCH_ON:
            if self.state in _SHUTDOWN:
                self.state = DriveState.READY_TO_SWITCH_ON
        elif not word & ENABLE_OPERATION:
            if self.state in _SWITCH_ON:
                self.state = DriveState.SWITCHED_ON
        elif self.state in _ENABLE:
            self.state = DriveState.OPERATION_ENABLED
        return reset
