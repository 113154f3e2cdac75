"""All devices of a rig that run beside the cycle, as one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

from rigd.config.rig import DeviceConfig, RigConfig
from rigd.engine.cycle import DEVICE_ERRORS
from rigd.engine.shared import Job, RowRing, RunFolder
from rigd.engine.slow.block_helper import BlockHelper
from rigd.engine.slow.devices import SlowDevices
from rigd.engine.slow.latest import Latest
from rigd.engine.slow.table import LatestTable
from rigd.model.channels import Stream
from rigd.sdk import BlockDriver, Driver, SlowDriver

#: The table of latest values in the folder of a run.
TABLE: Final = "latest"


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
        decimation: Mapping[str, int],
    ) -> None:
        streams = beside(rig)
        path = folder.path / TABLE
        table = LatestTable.create(path, streams)
        drivers: dict[str, SlowDriver] = {}
        self._helpers: list[BlockHelper] = []
        for stream in streams:
            device = rig.devices[stream.name]
            if issubclass(device.driver_class, BlockDriver):
                self._helpers.append(
                    BlockHelper(
                        device,
                        ring=folder.ring_path(job, stream.name),
                        every=decimation.get(stream.name, 1),
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
                name: EveryNth(rings[name], decimation[name]) for name in drivers if name in rings
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


class EveryNth:
    """Passes every n-th row on to a ring."""

    def __init__(self, ring: RowRing, every: int) -> None:
        self._ring = ring
        self._every = every
        self._count = 0

    def push(self, t_ns: int, row: Sequence[float]) -> None:
        """Take one row."""
        if self._count % self._every == 0:
            self._ring.push(t_ns, row)
        self._count += 1


def beside(rig: RigConfig) -> list[Stream]:
    """Return the streams of the devices of ``rig`` that run beside the cycle."""
    return [
        device.stream
        for device in rig.devices.values()
        if not issubclass(device.driver_class, Driver)
    ]


def stand_ins(rig: RigConfig, folder: Path) -> Callable[[DeviceConfig], Driver]:
    """Return what the cycle of the run in ``folder`` reads of the devices beside it."""
    streams = beside(rig)
    table = LatestTable.attach(folder / TABLE, streams) if streams else None

    def stand_in(device: DeviceConfig) -> Driver:
        if table is None:
            raise TypeError(f"{device.name} does not run beside the cycle")
        return Latest(device, table.slot(device.name))

    return stand_in
