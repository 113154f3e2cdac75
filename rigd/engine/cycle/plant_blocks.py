"""Runs a block device of a simulated plant in the cycle, and records its rows block by block.

A block device is a device whose library returns blocks of rows.
"""

from __future__ import annotations

from collections.abc import Sequence

from rigd.config.rig import DeviceConfig
from rigd.engine.cycle.block_rows import BlockRecorder, BlockRows, BlockSink
from rigd.engine.cycle.stand_in import StandIn
from rigd.engine.play.windows import Windows
from rigd.model.errors import DeviceError
from rigd.sdk import BlockDriver, Plant


class PlantBlocks(StandIn):
    """Runs a block driver on ``plant`` and replaces it in the cycle.

    All rows of its blocks go to its own sink (:meth:`record`), with their own times; the cycle gets
    the newest row.
    """

    def __init__(self, device: DeviceConfig, plant: Plant) -> None:
        super().__init__(device)
        driver = device.driver_class(device.config, plant)
        if not isinstance(driver, BlockDriver):
            raise TypeError(f"{device.driver} is not a block driver")
        self._silent_ns = round(self.declaration.silent_s * 1e9)
        self._driver = driver
        self._plant = plant
        self._rows = BlockRows(device.stream)
        self._recorder: BlockRecorder | None = None
        self._started = False

    def record(self, sink: BlockSink, every: int, windows: Windows | None) -> None:
        """Start to record every ``every``-th row in ``sink``, of those inside ``windows``."""
        self._recorder = BlockRecorder(sink, every, windows)

    def open(self) -> None:
        """Open the device; it samples from the first cycle on."""
        self._driver.open()
        self.identity = self._driver.identity

    def preflight(self) -> Sequence[str]:
        """Return the reasons of the device itself."""
        return self._driver.preflight()

    def read(self, t_ns: int) -> Sequence[float] | None:
        """Take all available blocks; return the newest row, or None without a new row.

        Raises:
            DeviceError: the device reports a fault, or its rows violate the interface of drivers.
        """
        driver = self._driver
        self._plant.advance(t_ns)
        if not self._started:
            driver.start()
            self._started = True
        newest = None
        while (block := driver.read_block(0.0)) is not None and len(block.times_ns):
            rows = self._rows.make(block)
            newest = block
            self.taken_ns = int(block.times_ns[-1])
            if self.taken_ns > t_ns:
                ahead_s = (self.taken_ns - t_ns) * 1e-9
                raise DeviceError(
                    f"the driver returned a row that is {ahead_s:.6g} s ahead of the plant",
                    hint="correct its read_block()",
                )
            if self._recorder is not None:
                self._recorder.take(rows)
        if self._recorder is not None:
            self._recorder.settle()
        if newest is None or t_ns - self.taken_ns > self._silent_ns:
            return None
        return driver.newest_row(newest)

    def close(self) -> None:
        """Close the device, and record its last rows."""
        self._driver.close()
        if self._recorder is not None:
            self._recorder.finish()
