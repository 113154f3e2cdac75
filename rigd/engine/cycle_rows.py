"""Puts the rows of a cycle into the rings of their streams."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from rigd.engine.block_rows import BlockSink
from rigd.engine.mount import CYCLE_STREAM, Mount, MountedRig
from rigd.engine.plant_blocks import PlantBlocks
from rigd.engine.windows import StepWindows, Windows
from rigd.model.channels import STALE
from rigd.procedure.program import Recorded


class RowSink(Protocol):
    """Where the rows of one stream go; never waits."""

    def push(self, t_ns: int, row: Sequence[float]) -> None:
        """Take one row: the values in order, the status word (an int) last where there is one."""
        ...


class CycleRows:
    """Pushes what the cycle has read and written to ``rings``, as ``record`` says.

    Blocks that are read in the cycle go to ``blocks``, row by row at their own times. ``windows``
    are those of the streams that another process records.
    """

    def __init__(
        self,
        rig: MountedRig,
        rings: Mapping[str, RowSink],
        record: Mapping[str, Recorded],
        blocks: Mapping[str, BlockSink],
        windows: Mapping[str, Windows],
    ) -> None:
        self._windows = StepWindows(record, windows)
        self._devices: list[tuple[Mount, int, RowSink, int, Windows | None]] = []
        self._own: tuple[RowSink, int, Windows | None] | None = None
        for index, mount in enumerate(rig.mounts):
            name = mount.name
            if isinstance(mount.driver, PlantBlocks):
                if name in blocks:
                    mount.driver.record(blocks[name], record[name].every, self._windows.of(name))
            elif name in rings:
                every, window = record[name].every, self._windows.of(name)
                self._devices.append((mount, index, rings[name], every, window))
        name = CYCLE_STREAM.name
        if name in rings:
            self._own = rings[name], record[name].every, self._windows.of(name)

    def decide(self, t_ns: int, step: str) -> None:
        """Say which step plays in the cycle at ``t_ns`` ("": none); before :meth:`push`."""
        self._windows.decide(t_ns, step)

    def push(
        self,
        t_ns: int,
        slot: int,
        values: Sequence[float],
        setpoints: Sequence[float],
        stamps: Sequence[int],
    ) -> None:
        """Push the row of every device that has one in this cycle.

        ``values`` and ``setpoints`` are the tables of the rig; ``stamps`` say how old they are.
        """
        for mount, index, ring, every, window in self._devices:
            fresh = stamps[index] == t_ns
            if slot % every or not (fresh or mount.driver.every_cycle):
                continue
            if window is not None and not window.is_open:
                continue
            row = list(values[mount.values])
            if mount.driver.has_status:
                status = row.pop()
                # NaN: the device has not answered yet; all bits set says "unknown".
                row += setpoints[mount.commands]
                word = int(status) if status == status else 0xFFFFFFFF
                row.append(word if fresh else word | STALE)
            else:
                row += setpoints[mount.commands]
            ring.push(t_ns, row)

    def push_own(self, t_ns: int, slot: int, row: Sequence[float]) -> None:
        """Push what the cycle says about itself."""
        if self._own is None:
            return
        ring, every, window = self._own
        if slot % every == 0 and (window is None or window.is_open):
            ring.push(t_ns, row)
