"""Checks that the process data (PDOs) of a CANopen node arrive once after every SYNC."""

from __future__ import annotations

from typing import Final

from rigd.sdk import ProtocolError
from rigd_drivers.can.canopen.pdo import Pdo

#: A TPDO that comes more often than SYNC in so many cycles in a row is of two nodes: one that was
#: late by a few cycles for long, and no longer is, sends as many more at once.
_DOUBLED_CYCLES: Final = 20
#: SYNCs that may still be answered; older ones are lost, not late. A stalled node, or a stalled
#: bus adapter, answers all that it missed at once.
_LATEST_SYNCS: Final = 200
#: After so many SYNCs in a row with one answer each, those not answered before are lost, not late.
_STEADY_SYNCS: Final = 50


class Inbox:
    """The newest values of one synchronous TPDO of node ``node``."""

    def __init__(self, pdo: Pdo, node: int, syncs: int = 0) -> None:
        self._name = f"{pdo} (0x{pdo.identifier:03X}) of node {node}"
        self._layout = pdo.layout()
        self._data = b""
        self._came = 0
        self._due = 0
        self._syncs = syncs
        self._doubled = 0
        self._steady = 0

    def receive(self, data: bytes) -> None:
        """Take in a frame."""
        self._data = data
        self._came += 1

    @property
    def came(self) -> int:
        """Frames that came since the last :meth:`take`."""
        return self._came

    def newest(self) -> tuple[int, ...] | None:
        """Return the values of the newest frame; None if it has not the length of the mapping."""
        if len(self._data) != self._layout.size:
            return None
        return self._layout.unpack(self._data)

    def take(self, syncs: int) -> tuple[int, ...] | None:
        """Return the values that came since the last call, or None; once per cycle.

        ``syncs`` is how many SYNCs were sent so far.

        Raises:
            ProtocolError: the frame has another length than its mapping, or comes more than once
                per SYNC, cycle after cycle: two nodes share the id.

        """
        came, self._came = self._came, 0
        sent, self._syncs = syncs - self._syncs, syncs
        due = min(self._due + sent, _LATEST_SYNCS)
        self._steady = self._steady + 1 if came == sent == 1 else 0
        self._due = max(0, due - came) if self._steady < _STEADY_SYNCS else 0
        if not came:
            return None
        self._doubled = self._doubled + 1 if came > due else 0
        if self._doubled >= _DOUBLED_CYCLES:
            raise ProtocolError(
                f"{self._name} comes more often than SYNC, {self._doubled} cycles in a row; "
                f"expected once",
                hint="two nodes may have this id, or another program sends SYNC on this bus; "
                "switch nodes off one by one",
            )
        if len(self._data) != self._layout.size:
            raise ProtocolError(
                f"{self._name} has {len(self._data)} bytes, mapped were {self._layout.size}",
                hint="the node has lost its mapping, or another one sends under its id",
            )
        return self._layout.unpack(self._data)
