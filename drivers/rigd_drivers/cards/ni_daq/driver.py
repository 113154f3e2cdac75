"""Reads blocks of samples from an NI card, converts volts to quantities, and times the samples."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from rigd.sdk import Block, BlockDriver, Channel, Declaration, DriverConfig
from rigd_drivers.cards.ni_daq.config import NiDaqConfig
from rigd_drivers.cards.ni_daq.daqmx import Daqmx
from rigd_drivers.cards.ni_daq.sample_clock import SampleClock

#: An input this close to an end of its range (as a share of it) is taken to be at the rail.
RAIL: Final = 0.999
#: Rows may be this late before the card counts as failed, besides five blocks.
SILENT_S: Final = 1.5


class NiDaq(BlockDriver[NiDaqConfig, None]):
    """Analogue inputs of an NI card, buffered continuously; it measures only.

    A row is, for every input, its quantity and its volts; then the card's own time (sample number
    over nominal rate, in s) and the card's rate by the machine's clock as estimated so far (in
    Hz). The status word has bit i set if input i is at an end of its range: its value is then
    a bound, not a measurement.
    """

    Config: ClassVar[type[DriverConfig]] = NiDaqConfig
    title: ClassVar[str] = "analogue inputs of an NI card"

    def __init__(self, config: NiDaqConfig, link: None = None) -> None:
        super().__init__(config, link)
        self._daqmx = Daqmx(config)
        self._volts = np.zeros((len(config.inputs), config.block))
        self._scale = np.array([item.gain for item in config.inputs])[:, np.newaxis]
        self._zero = np.array([item.zero for item in config.inputs])[:, np.newaxis]
        self._origin = np.array([item.origin for item in config.inputs])[:, np.newaxis]
        self._bits = (1 << np.arange(len(config.inputs)))[:, np.newaxis]
        self._rails = np.zeros((len(config.inputs), 2))
        self._clock: SampleClock | None = None

    @classmethod
    def declare(cls, config: NiDaqConfig) -> Declaration:
        """Return the channels of every input, and the two of the card's clock."""
        block_s = config.block / config.rate
        return Declaration(
            channels=(
                *(channel for item in config.inputs for channel in item.channels),
                Channel(
                    "device_time", "s", "sample number over nominal rate: the card's own clock"
                ),
                Channel(
                    "clock_rate", "Hz", "rate of the card's clock by this machine's, estimated"
                ),
            ),
            has_status=True,
            silent_s=SILENT_S + 5 * block_s,
            rate_hz=config.rate,
            oldest_s=block_s,  # and what the way to here takes: not known
        )

    def open(self) -> None:
        """Open the card and make its task; nothing is sampled yet.

        Raises:
            LinkError: NI-DAQmx, its server or the card is not there, or another program uses it.
            ProtocolError: it is another card than the rig file names.
            DeviceError: the card cannot do what the rig file asks.
        """
        self.identity = self._daqmx.open()
        self.rate_hz = self._daqmx.rate_hz()
        self._rails = RAIL * self._daqmx.ranges_v()

    def start(self) -> None:
        """Begin to sample."""
        self._clock = SampleClock(self.rate_hz, time.monotonic_ns())
        self._daqmx.start()

    def read_block(self, timeout_s: float) -> Block | None:
        """Return the next block of rows, a shorter block at the time-out, None without rows.

        Raises:
            DeviceError: samples were lost, or the card is gone.
            LinkError: the device server is gone.
            RuntimeError: it was not started.
        """
        if self._clock is None:
            raise RuntimeError("start() comes before read_block()")
        volts = self._daqmx.read(self._volts, timeout_s)
        arrived_ns = time.monotonic_ns()
        count = volts.shape[1]
        if count == 0:
            return None
        first = self._clock.count
        times_ns = self._clock.stamp(count, arrived_ns)
        return Block(times_ns, self._rows(volts, first, self._clock.rate_hz))

    def _rows(self, volts: NDArray[np.float64], first: int, rate_hz: float) -> NDArray[np.float64]:
        """Return the rows of ``volts`` (inputs, n), whose first sample has the number ``first``."""
        inputs, count = volts.shape
        rows = np.empty((count, 2 * inputs + 3))
        rows[:, 0 : 2 * inputs : 2] = ((volts - self._zero) * self._scale + self._origin).T
        rows[:, 1 : 2 * inputs : 2] = volts.T
        rows[:, -3] = (first + np.arange(count)) / self.rate_hz
        rows[:, -2] = rate_hz
        low, high = self._rails[:, :1], self._rails[:, 1:]
        rows[:, -1] = (self._bits * ((volts <= low) | (volts >= high))).sum(axis=0)
        return rows

    def newest_row(self, block: Block) -> Sequence[float]:
        """Return the last row, with the median of the last ``median`` samples for every input."""
        row: list[float] = block.values[-1].tolist()
        if self.config.median > 1:
            width = 2 * len(self.config.inputs)
            last = block.values[-self.config.median :, :width]
            row[:width] = np.median(last, axis=0).tolist()
        return row

    def close(self) -> None:
        """Stop sampling and release the card; closing twice is silent."""
        self._daqmx.close()
        self._clock = None
