"""Writes the rows of each cycle into the rings, the buffers from which the recorder reads rows."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Final, NamedTuple, Protocol

from rigd.computed.driver import Computed
from rigd.engine.cycle.block_rows import BlockRecorder, BlockSink
from rigd.engine.cycle.mount import CYCLE_STREAM, MountedRig
from rigd.engine.cycle.plant_blocks import PlantBlocks
from rigd.engine.play.conditions import Taken
from rigd.engine.play.windows import RecordWindows, Windows
from rigd.engine.shared import RowRing
from rigd.model.channels import STALE, Stream
from rigd.procedure.program import Recorded


class RowSink(Protocol):
    """Takes the rows of one stream; never waits."""

    def push(self, t_ns: int, row: Sequence[float]) -> None:
        """Append a row: the values in order, the status word (an int) last if there is one."""
        ...

    def push_packed(self, row: memoryview) -> None:
        """Append a row that has the bytes of the stream's row dtype already."""
        ...


class RingSink(RowSink, BlockSink, Protocol):
    """Takes single rows and many at once, as a ring does."""


class HeldRows:
    """Holds the rows of a stream until the cycle has decided about them, then passes them on.

    What is held grows with ``before`` of the capture; a procedure is refused if it is too much.
    """

    #: Rows are taken after this number of cycles: one row at a time would cost ten times as much.
    CYCLES: Final = 32

    def __init__(self, stream: Stream, sink: BlockSink, windows: Windows) -> None:
        self._newest = RowRing.unshared(stream, 2 * self.CYCLES)
        self._windows = windows
        self._recorder = BlockRecorder(sink, 1, windows)
        self._cycles = 0

    def push(self, t_ns: int, row: Sequence[float]) -> None:
        """Hold a row; at most one for each :meth:`settle`."""
        self._newest.push(t_ns, row)

    def push_packed(self, row: memoryview) -> None:
        """Hold a row that has the bytes of the stream's row dtype already."""
        self._newest.push_packed(row)

    def settle(self) -> None:
        """Pass on, at times, the rows about which the cycle has decided; call in every cycle."""
        self._cycles += 1
        if self._cycles >= self.CYCLES:
            self._cycles = 0
            self._recorder.take(self._newest.drain())
            if not self._recorder.waits:
                self._windows.forget()

    def finish(self) -> None:
        """Pass on the last rows, by the last decision of the cycle."""
        self._recorder.take(self._newest.drain())
        self._recorder.finish()


class _Pushed(NamedTuple):
    """A device whose rows are pushed: its places in the tables, and when they are pushed."""

    position: int
    places: slice
    commands: slice
    has_status: bool
    every_cycle: bool
    ring: RowSink
    every: int
    window: Windows | None


class CycleRows:
    """Pushes the values that the cycle has read and written to ``rings``, according to ``record``.

    Blocks that are read in the cycle go to ``blocks``, row by row at their own times. ``windows``
    are those of the streams that another process records, ``taken`` the times of the values.
    """

    def __init__(
        self,
        rig: MountedRig,
        rings: Mapping[str, RingSink],
        record: Mapping[str, Recorded],
        blocks: Mapping[str, BlockSink],
        windows: Mapping[str, Windows],
        taken: Taken | None = None,
    ) -> None:
        self._windows = RecordWindows(record, windows, {**rig.readings, **rig.status}, taken)
        self._held: list[HeldRows] = []
        self._devices: list[_Pushed] = []
        self._computed: list[tuple[RowSink, memoryview, int, Windows | None]] = []
        self._own: tuple[RowSink, int, Windows | None] | None = None
        for index, mount in enumerate(rig.mounts):
            name = mount.name
            if isinstance(mount.driver, PlantBlocks):
                if name in blocks:
                    mount.driver.record(blocks[name], record[name].every, self._windows.of(name))
            elif name in rings:
                every = record[name].every
                sink, window = self._sink(mount.stream, rings[name], record[name])
                if isinstance(mount.driver, Computed):
                    self._computed.append((sink, mount.driver.packed, every, window))
                    continue
                declared = mount.driver.declaration
                self._devices.append(
                    _Pushed(
                        index,
                        mount.values,
                        mount.commands,
                        declared.has_status,
                        declared.every_cycle,
                        sink,
                        every,
                        window,
                    )
                )
        name = CYCLE_STREAM.name
        if name in rings:
            sink, window = self._sink(CYCLE_STREAM, rings[name], record[name])
            self._own = sink, record[name].every, window

    def _sink(
        self, stream: Stream, ring: RingSink, recorded: Recorded
    ) -> tuple[RowSink, Windows | None]:
        """Return where rows of ``stream`` go, and the windows in which they go there at once."""
        windows = self._windows.of(stream.name)
        if windows is None or recorded.capture is None:
            return ring, windows
        held = HeldRows(stream, ring, windows)
        self._held.append(held)
        return held, None

    def decide(
        self, t_ns: int, step: str, values: Sequence[float]
    ) -> Sequence[Mapping[str, object]]:
        """Set the step that plays in the cycle at ``t_ns`` ("": none); call before :meth:`push`.

        Returns what has begun or ended to be captured.
        """
        changed = self._windows.decide(t_ns, step, values)
        for held in self._held:
            held.settle()
        return changed

    def finish(self, t_ns: int) -> None:
        """Decide about all rows until ``t_ns``, and push those that were held."""
        self._windows.finish(t_ns)
        for held in self._held:
            held.finish()

    def keep(self, positions: Collection[int]) -> None:
        """Push from now on only the rows of the devices at ``positions``."""
        self._devices = [pushed for pushed in self._devices if pushed.position in positions]

    def push(
        self,
        t_ns: int,
        slot: int,
        values: list[float],
        setpoints: Sequence[float],
        stamps: Sequence[int],
        fresh: Sequence[bool],
    ) -> None:
        """Push the row of every device that has a row in this cycle.

        ``values`` and ``setpoints`` are the tables of the rig; ``stamps`` are the times of the
        values, ``fresh`` is whether this cycle has read them.
        """
        for pushed in self._devices:
            position, places, commands, has_status, steady, ring, every, window = pushed
            new = fresh[position]
            if slot % every or not (new or steady):
                continue
            if window is not None and not window.is_open:
                continue
            row = values[places]
            if has_status:
                status = row.pop()
                # NaN: the device has not answered yet; all bits set means "unknown".
                row += setpoints[commands]
                word = int(status) if status == status else 0xFFFFFFFF
                row.append(word if new else word | STALE)
            else:
                row += setpoints[commands]
            ring.push(stamps[position] if new else t_ns, row)

    def push_computed(self, slot: int) -> None:
        """Push the rows that this cycle has computed, as they are packed."""
        for ring, packed, every, window in self._computed:
            if slot % every == 0 and (window is None or window.is_open):
                ring.push_packed(packed)  # a row of its cycle, however old the readings in it are

    def push_own(self, t_ns: int, slot: int, row: Sequence[float]) -> None:
        """Push the cycle's own counters and times."""
        if self._own is None:
            return
        ring, every, window = self._own
        if slot % every == 0 and (window is None or window.is_open):
            ring.push(t_ns, row)
