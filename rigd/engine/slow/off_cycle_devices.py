"""Starts, supervises and stops all off-cycle devices of a rig, which run outside the cycle."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from rigd.config.rig import RigConfig
from rigd.engine.cycle.cycle import DEVICE_ERRORS
from rigd.engine.play.windows import Windows
from rigd.engine.shared import Job, RowRing, RunFolder
from rigd.engine.slow.block_helper import BlockHelper
from rigd.engine.slow.devices import SlowDevices
from rigd.engine.slow.orders import ORDERS, DeviceOrders, Orders, acting_devices
from rigd.engine.slow.stand_ins import TABLE, off_cycle_streams
from rigd.engine.slow.table import LatestTable
from rigd.procedure.program import Recorded
from rigd.sdk import BlockDriver, SlowDriver


class OffCycleDevices:
    """Starts, watches and stops the block and the slow devices of ``rig``.

    ``folder`` is prepared with the rings of ``job``; ``origin_ns`` is the monotonic time of the
    job's ``start_ns``. The table of latest values is made at once, so that the cycle can attach to
    it. Opening and proofs of watchdogs end early once ``stopped`` returns True.
    """

    def __init__(
        self,
        rig: RigConfig,
        folder: RunFolder,
        job: Job,
        *,
        origin_ns: int,
        record: Mapping[str, Recorded],
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        streams = off_cycle_streams(rig)
        path = folder.path / TABLE
        table = LatestTable.create(path, streams)
        drivers: dict[str, SlowDriver] = {}
        self._helpers: list[BlockHelper] = []
        for stream in streams:
            device = rig.devices[stream.name]
            selection = record.get(stream.name, Recorded())
            if issubclass(device.driver_class, BlockDriver):
                self._helpers.append(
                    BlockHelper(
                        device,
                        ring=folder.ring_path(job, stream.name),
                        every=selection.every,
                        windowed=selection.windowed,
                        table=path,
                        table_streams=streams,
                        start_ns=job.start_ns,
                        origin_ns=origin_ns,
                        log=folder.path / f"{stream.name}.log",
                        lock_fd=folder.lock_fd,
                        stopped=stopped,
                    )
                )
            else:
                driver = device.driver_class(device.config, None)
                if not isinstance(driver, SlowDriver):
                    raise TypeError(f"{device.driver} is not a driver of a known kind")
                drivers[stream.name] = driver
        rings = folder.row_rings(job)
        self._slow = SlowDevices(
            drivers,
            rings={
                name: SlowRows(
                    rings[name],
                    record[name].every,
                    table.windows(name) if record[name].windowed else None,
                )
                for name in drivers
                if name in rings
            },
            slots={name: table.slot(name) for name in drivers},
            start_ns=job.start_ns,
            origin_ns=origin_ns,
            orders=_orders(rig, folder),
            stopped=stopped,
        )
        self._has_slow = bool(drivers)

    def start(self) -> Sequence[str]:
        """Open all devices at the same time; return the reasons why the rig cannot be armed."""
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
            reasons += [f"{helper.name}: {reason}" for reason in helper.arming_blockers]
        if self._has_slow and not reasons:
            reasons += self._slow.arming_blockers
        return reasons

    @property
    def identities(self) -> dict[str, str]:
        """The identity that each device reported, after the start."""
        return {helper.name: helper.identity for helper in self._helpers} | self._slow.identities

    @property
    def acting(self) -> Collection[str]:
        """The names of the slow devices that take setpoints."""
        return self._slow.acting

    def prove_watchdogs(self) -> tuple[Mapping[str, float], Sequence[str]]:
        """See :meth:`SlowDevices.prove_watchdogs`."""
        return self._slow.prove_watchdogs() if self._slow.acting else ({}, ())

    def make_safe(self) -> Sequence[str]:
        """Make the slow devices that take setpoints safe; see :meth:`SlowDevices.make_safe`."""
        return self._slow.make_safe() if self._slow.acting else ()

    def act(self, device: str, action: str) -> str:
        """Perform an action of a slow device; see :meth:`SlowDevices.act`.

        It waits for the result, so it is called in a separate thread.
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


def _orders(rig: RigConfig, folder: RunFolder) -> Mapping[str, DeviceOrders]:
    acting = acting_devices(rig)
    if not acting:
        return {}
    orders = Orders.create(folder.path / ORDERS, acting)
    found = {device.name: orders.of(device.name) for device in acting}
    return {name: item for name, item in found.items() if item is not None}


class SlowRows:
    """Passes every n-th row of a slow device to a ring, during the ``windows`` only."""

    def __init__(self, ring: RowRing, every: int, windows: Windows | None) -> None:
        self._ring = ring
        self._every = every
        self._windows = windows
        self._count = 0

    def push(self, t_ns: int, row: Sequence[float]) -> None:
        """Append a row on arrival, by the last decision of the cycle."""
        recorded = self._count % self._every == 0
        self._count += 1
        if recorded and self._windows is not None:
            self._windows.forget()  # those since the row before do not concern this one
            recorded = bool(self._windows.covers(np.array([t_ns]))[0])
        if recorded:
            self._ring.push(t_ns, row)
