"""Sets the position of a CiA 402 drive to zero where it stands, by its homing mode.

Source: CiA 402-2, homing mode (6), methods 35 and 37; KEB Combivert F6, manual, page 151, has the
same with bits 10, 12 and 13. No method that moves is used: the drive would move on its own, at a
speed that no limit of the rig bounds.
"""

from __future__ import annotations

from typing import Final, Literal

from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd_drivers.can.canopen import cia402, objects
from rigd_drivers.can.canopen.cia402 import DriveState, Mode
from rigd_drivers.can.cia402_servo.by_sdo import NOT_ENABLED
from rigd_drivers.can.errand import Errand, Part, Pause, Read, Script, Write, nearer, until
from rigd_drivers.can.node import Node
from rigd_drivers.wait import looks

#: Homing methods that do not move: 37, and 35 of older drives.
Method = Literal[35, 37]
#: A drive shows a mode within this, in s.
_MODE_S: Final = 0.5
#: It is enabled within this (brake, charging of its power stage), and homed within this, in s.
_ENABLE_S: Final = 3.0
_HOME_S: Final = 2.0


class Homing:
    """Homes one drive in the cycle; its PDOs carry :attr:`word` and bring :attr:`shown`."""

    def __init__(self) -> None:
        self.word = cia402.DISABLE_VOLTAGE  #: controlword to be sent while the drive is not armed
        self.shown = 0  #: newest statusword
        self._errand: Errand | None = None

    def begin(self, node: Node, method: Method, mode: Mode, span: int) -> None:
        """Begin to home ``node`` by ``method``; the drive is left switched off in ``mode``.

        Its position begins again after ``span`` counts.

        Raises:
            DeviceError: that is in progress.

        """
        if self._errand is not None:
            raise DeviceError(f"{node} is being homed already")
        self._errand = Errand(node, self._home(node, method, mode, span))

    def advance(self) -> str | None:
        """Return what the drive shows once it is homed, None before; once per cycle.

        Raises:
            LinkError, ProtocolError: it does not answer, or refuses.
            DeviceError: it is not enabled, reports a homing error, or does not show zero.

        """
        if self._errand is None:
            return None
        try:
            told = self._errand.advance()
        except (LinkError, ProtocolError, DeviceError):
            self.end()
            raise
        if told is not None:
            self.end()
        return told

    def end(self) -> None:
        """Switch the drive off with the next PDO, and send nothing else."""
        self._errand, self.word = None, cia402.DISABLE_VOLTAGE

    def _home(self, node: Node, method: Method, mode: Mode, span: int) -> Script:
        problem: LinkError | ProtocolError | DeviceError | None = None
        before = shown = 0
        try:
            modes = yield Read(objects.SUPPORTED_MODES)
            if not modes >> (Mode.HOMING - 1) & 1:
                raise ProtocolError(
                    f"{node} has no homing mode (6): object 6502 is 0x{modes:X}",
                    hint="leave `homing` out; `zero` takes the count at zero from the rig file",
                )
            before = yield Read(objects.POSITION)
            yield Write(objects.HOMING_METHOD, method)
            yield from _set_mode(node, Mode.HOMING)
            yield from self._enable(node)
            shown = yield from self._set_zero(node, before, span)
        except (LinkError, ProtocolError, DeviceError) as error:
            problem = error
        self.word = cia402.DISABLE_VOLTAGE
        try:
            yield from _set_mode(node, mode)
        except (LinkError, ProtocolError, DeviceError) as error:
            problem = problem or error
        if problem is not None:
            raise problem
        return f"{node} shows {shown} counts, before {before}"

    def _enable(self, node: Node) -> Part:
        enabling = cia402.Enabling()
        for _ in looks(_ENABLE_S):
            self.word = enabling.next(self.shown)
            yield Pause()
            if cia402.state_of(self.shown) is DriveState.ENABLED:
                return self.shown
        raise DeviceError(
            f"{node} is not enabled for homing: {cia402.state_of(self.shown).value} "
            f"(statusword 0x{self.shown:04X})",
            hint=NOT_ENABLED,
        )

    def _set_zero(self, node: Node, before: int, span: int) -> Part:
        """Start homing; return the position that the drive shows then."""
        self.word = cia402.ENABLE | cia402.START_HOMING
        count = before
        for _ in looks(_HOME_S):
            yield Pause()
            if self.shown & cia402.HOMING_ERROR:
                raise DeviceError(
                    f"{node} reports a homing error (statusword 0x{self.shown:04X})",
                    hint="its manual states which homing methods it has (object 6098), and when "
                    "it refuses them",
                )
            count = yield Read(objects.POSITION)
            if self.shown & cia402.HOMED and nearer(count, 0, before, span):
                return count
        raise DeviceError(
            f"{node} is not homed after {_HOME_S:g} s: its position is {count}, before {before} "
            f"(statusword 0x{self.shown:04X})",
            hint="homing must set the position (object 6064) to 0: its home offset (607C, or an "
            "object of its maker) may have another value",
        )


def _set_mode(node: Node, mode: Mode) -> Part:
    yield Write(objects.MODE, mode)
    return (
        yield from until(
            objects.MODE_DISPLAY, lambda shown: shown == mode, _MODE_S,
            f"{node} does not show mode {mode:d}",
        )
    )  # fmt: skip
