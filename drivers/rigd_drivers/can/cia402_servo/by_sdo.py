"""Configures a CiA 402 drive and changes its state by SDO, before the cycle starts."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd_drivers.can.bus import CanBus
from rigd_drivers.can.canopen import cia402, emcy, nmt, objects
from rigd_drivers.can.canopen.cia402 import DriveState, Mode
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.node import RESCUE_TIMEOUT_S, Node
from rigd_drivers.wait import looks

#: 6007h: what the drive does when it loses our heartbeat. 2 switches the voltage off at once; a
#: quick stop (3) would keep torque on the wheel.
DISABLE_VOLTAGE_OPTION: Final = 2
#: Counts of the position (6064h), which has 32 bits, of a drive without a range.
WHOLE_POSITION: Final = 1 << 32
#: A drive takes a controlword, and shows a mode, within this, in s.
_STEP_S: Final = 0.5
#: Pause between two reads of an object that is waited for, in s.
LOOK_S: Final = 0.002
#: States in which a drive gives no torque.
TORQUELESS: Final = (
    DriveState.NOT_READY,
    DriveState.SWITCH_ON_DISABLED,
    DriveState.READY,
    DriveState.SWITCHED_ON,
    DriveState.FAULT,
)
NOT_ENABLED: Final = "check the supply of its power stage, safe torque off, and the enable input"


def state(node: Node) -> DriveState:
    """Return the state that the drive is in."""
    return cia402.state_of(node.read(objects.STATUSWORD))


def reached(node: Node, states: Collection[DriveState], timeout_s: float) -> bool:
    """Wait until the drive is in one of ``states``, at most ``timeout_s``; return whether it is."""
    for _ in looks(timeout_s):
        if state(node) in states:
            return True
        node.bus.wait(lambda: False, LOOK_S)
    return False


def reports_silence(node: Node) -> bool:
    """Return whether the emergency that was not looked at yet blames a silent master."""
    return node.emergency is not None and node.emergency.code in emcy.MASTER_SILENT


def watch_heartbeat(node: Node, watchdog_s: float) -> None:
    """Have the drive switch itself off after ``watchdog_s`` without a heartbeat of ours.

    Zero is written first, so that it begins again, with the first heartbeat that it receives.

    Raises:
        LinkError, ProtocolError: it does not answer, or refuses.

    """
    first, *kept = watch_writes(node.bus.config.master_node, watchdog_s)
    node.write(*first)
    for entry, value in kept:
        node.ensure(entry, value)
    # Optional by CiA 402-2: what a drive without it does, the proof of the watchdog shows.
    node.ensure_optional(objects.ABORT_CONNECTION_OPTION, DISABLE_VOLTAGE_OPTION)


def watch_writes(master: int, watchdog_s: float) -> list[tuple[Entry, int]]:
    """Return what :func:`watch_heartbeat` writes, in this order."""
    return [
        (objects.HEARTBEAT_CONSUMER, 0),
        (objects.HEARTBEAT_CONSUMER, master << 16 | round(watchdog_s * 1e3)),
    ]


def set_mode(node: Node, mode: Mode) -> None:
    """Set the mode of operation, and see that the drive shows it.

    Raises:
        LinkError: the drive does not answer.
        ProtocolError: it has no such mode, or does not take it.

    """
    modes = node.read(objects.SUPPORTED_MODES)
    if not modes >> (mode - 1) & 1:
        raise ProtocolError(
            f"{node} does not offer the {mode.title} mode ({mode:d}): object 6502 is 0x{modes:X}",
            hint="update its firmware, use another drive, or name another mode in a `profile`",
        )
    node.write(objects.MODE, mode)
    shown = None
    for _ in looks(_STEP_S):
        if (shown := node.read(objects.MODE_DISPLAY)) == mode:
            return
        node.bus.wait(lambda: False, LOOK_S)
    raise ProtocolError(f"{node} shows mode {shown} (object 6061), commanded was {mode:d}")


def position_span(node: Node) -> int:
    """Return after how many counts the position (6064h) begins again.

    That is its range (607Bh, CiA 402-2), if the drive has one that is narrower than 32 bits; limits
    that are both 0 are no range.

    Raises:
        LinkError, ProtocolError: it does not answer, or refuses.

    """
    low = node.read_optional(objects.POSITION_LOW)
    high = node.read_optional(objects.POSITION_HIGH)
    if low is None or high is None or high <= low:
        return WHOLE_POSITION
    return high - low + 1


def switch_off(node: Node) -> None:
    """Switch the drive off, and reset its fault if it has one.

    Raises:
        LinkError, ProtocolError: it does not answer, or refuses.
        DeviceError: the fault stays.
    """
    node.write(objects.CONTROLWORD, cia402.DISABLE_VOLTAGE)
    if state(node) is DriveState.SWITCH_ON_DISABLED:
        return
    node.write(objects.CONTROLWORD, cia402.FAULT_RESET)
    off = reached(node, (DriveState.SWITCH_ON_DISABLED,), _STEP_S)
    node.write(objects.CONTROLWORD, cia402.DISABLE_VOLTAGE)
    node.emergency = None  # of a fault that is reset by now, or is reported below
    if not off:
        last = node.read_optional(objects.LAST_ERROR)
        cause = f"; last error: {emcy.describe(last & 0xFFFF)}" if last else ""
        raise DeviceError(
            f"{node} stays in {state(node).value}{cause}",
            hint="remove the cause, then switch the drive off and on",
        )


def force_off(bus: CanBus, node_id: int) -> None:
    """Switch a drive off, and check that it gives no torque.

    A node that another master has stopped takes neither PDOs nor SDOs (CiA 301, 7.3.2.2.4); it is
    made pre-operational then. An answer to another question may still come; the order is then
    given once more. Takes some 0.5 s at most, and asks no EDS.

    Raises:
        LinkError: it does not answer.
        ProtocolError: it refuses.
        DeviceError: it is still enabled.

    """
    node = Node(bus, node_id)
    node.sdo_timeout_s = RESCUE_TIMEOUT_S
    node.attach()
    try:
        node.write(objects.CONTROLWORD, cia402.DISABLE_VOLTAGE)
    except (LinkError, ProtocolError):
        node.order(nmt.Command.PRE_OPERATIONAL)
        node.write(objects.CONTROLWORD, cia402.DISABLE_VOLTAGE)
    if not reached(node, TORQUELESS, RESCUE_TIMEOUT_S):
        raise DeviceError(f"{node} did not switch off: it is in {state(node).value}")


def enable(node: Node) -> None:
    """Enable the drive, step by step; its target must be zero.

    Raises:
        LinkError, ProtocolError: it does not answer, or refuses.
        DeviceError: it does not follow.

    """
    for word, following in (
        (cia402.SHUTDOWN, DriveState.READY),
        (cia402.SWITCH_ON, DriveState.SWITCHED_ON),
        (cia402.ENABLE, DriveState.ENABLED),
    ):
        node.write(objects.CONTROLWORD, word)
        if not reached(node, (following,), _STEP_S):
            raise DeviceError(
                f"{node} stays in {state(node).value}, expected {following.value}",
                hint=NOT_ENABLED,
            )
