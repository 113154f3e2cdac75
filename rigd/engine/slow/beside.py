"""Starts, supervises and stops all off-cycle devices of a rig."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from rigd.config.rig import RigConfig
from rigd.engine.cycle import DEVICE_ERRORS
from rigd.engine.shared import Job, RowRing, RunFolder
from rigd.engine.slow.block_helper import BlockHelper
from rigd.engine.slow.devices import SlowDevices
from rigd.engine.slow.stand_ins import TABLE, beside
from rigd.engine.slow.table import LatestTable
from rigd.engine.windows import Windows
from rigd.procedure.program import Recorded
from rigd.sdk import BlockDriver, SlowDriver


class Beside:
    """Starts, watches and stops the block and the slow devices of ``rig``.

    ``folder`` is prepared with the rings of ``job``; ``origin_ns`` is the monotonic time of the
    job's ``start_ns``. The table of latest values is made at once, for the cycle to attach to.
    """

    def __init__(
        self,
        rig: RigConfig,
        folder: RunFolder,
        job: Job,
        *,
        origin_ns: int,
        record: Mapping[str, Recorded],
    ) -> None:
        streams = beside(rig)
        path = folder.path / TABLE
        table = LatestTable.create(path, streams)
        drivers: dict[str, SlowDriver] = {}
        self._helpers: list[BlockHelper] = []
        for stream in streams:
            device = rig.devices[stream.name]
            what = record.get(stream.name, Recorded())
            if issubclass(device.driver_class, BlockDriver):
                self._helpers.append(
                    BlockHelper(
                        device,
                        ring=folder.ring_path(job, stream.name),
                        every=what.every,
                        windowed=bool(what.during),
                        table=path,
                        table_streams=streams,
                        start_ns=job.start_ns,
                        origin_ns=origin_ns,
                        log=folder.path / f"{stream.name}.log",
                        lock_fd=folder.lock_fd,
                    )
                )
            else:
                driver = device.driver_class(device.config, None)
                if not isinstance(driver, SlowDriver):
                    raise TypeError(f"{device.driver} is no driver of a known kind")
                drivers[stream.name] = driver
        rings = folder.row_rings(job)
        self._slow = SlowDevices(
            drivers,
            rings={
                name: SlowRows(
                    rings[name],
                    record[name].every,
                    table.windows(name) if record[name].during else None,
                )
                for name in drivers
                if name in rings
            },
            slots={name: table.slot(name) for name in drivers},
            start_ns=job.start_ns,
            origin_ns=origin_ns,
        )
        self._has_slow = bool(drivers)

    def start(self) -> Sequence[str]:
        """Open all devices at the same time; return what keeps the rig from being armed."""
        starts: list[Callable[[], None]] = [helper.start for helper in self._helpers]
        if self._has_slow:
            starts.append(self._slow.start)
        if not starts:
            return ()
        reasons: list[str] = []
        with ThreadPoolExecutor(len(starts)) as pool:
            for begun in [pool.submit(start) for start in starts]:
                try:
                    begun.result()
                except DEVICE_ERRORS as error:
                    reasons.append(str(error))
        for helper in self._helpers:
            reasons += [f"{helper.name}: {reason}" for reason in helper.unfit]
        if self._has_slow and not reasons:
            reasons += self._slow.unfit
        return reasons

    @property
    def identities(self) -> dict[str, str]:
        """What every device said it is, once started."""
        return {helper.name: helper.identity for helper in self._helpers} | self._slow.identities

    def act(self, device: str, action: str) -> str:
        """Do what a person asks of a slow device; see :meth:`SlowDevices.act`.

        Waits for it, so it is called in a thread of its own.
        """
        return self._slow.act(device, action)

    def poll(self) -> str | None:
        """Return why the run must end, or None."""
        for helper in self._helpers:
            reason = helper.poll()
            if reason is not None:
                return reason
        return self._slow.poll() if self._has_slow else None

    def stop(self) -> None:
        """Stop and close all devices; stopping twice is silent."""
        for helper in self._helpers:
            helper.stop()
        if self._has_slow:
            self._slow.stop()


class SlowRows:
    """Passes every n-th row of a slow device on to a ring, where ``windows`` say so."""

    def __init__(self, ring: RowRing, every: int, windows: Windows | None) -> None:
        self._ring = ring
        self._every = every
        self._windows = windows
        self._count = 0

    def push(self, t_ns: int, row: Sequence[float]) -> None:
        """Take one row, as it comes: what the cycle is about to decide does not count yet."""
        recorded = self._count % self._every == 0
        self._count += 1
        if recorded and (self._windows is None or self._windows.covers(np.array([t_ns]))[0]):
            self._ring.push(t_ns, row)
