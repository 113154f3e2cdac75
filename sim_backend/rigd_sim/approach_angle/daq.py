"""Simulates the data acquisition card of the approach-angle rig."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar, Final, Self

from annotated_types import Ge, Le
from pydantic import model_validator

from rigd.sdk import (
    Block,
    BlockDriver,
    Channel,
    Declaration,
    DeviceError,
    DriverConfig,
    In,
    wrong_entry,
)
from rigd_sim.approach_angle import layout
from rigd_sim.approach_angle.layout import LATEST_JITTER
from rigd_sim.approach_angle.plant import AnglePlant

if TYPE_CHECKING:  # a rig file is checked without numpy and the physics
    import numpy as np
    from numpy.typing import NDArray

    from rigd_sim.approach_angle.acquisition import Acquisition, Samples

#: (unit, what it is) of the inputs, in the order of ``layout.SIGNALS``.
_INPUTS: Final = (
    ("1", "strain that gauge a at +45 degrees shows"),
    ("1", "strain that gauge b at -45 degrees shows"),
    ("rad", "angle of the wheel since its start"),
    ("m", "travel of the platform since its start"),
    ("N", "normal force of the contact by the load cell"),
)
#: An input this close to an end of its range (as a share of it) is taken to be at the rail.
RAIL: Final = 0.999


class DaqConfig(DriverConfig):
    """How the card samples, and how late its blocks come."""

    rate: Annotated[float, In("Hz"), Ge(100), Le(9600)] = 9600.0
    """Samples per second of each input."""
    block: Annotated[int, Ge(1), Le(9600)] = 96
    """Samples of each input that are fetched together."""
    median: Annotated[int, Ge(1), Le(1000)] = 5
    """Interlocks and end conditions see the median of so many of a block's last samples, so that
    no single noisy one stops a run."""
    load_cell: bool = False
    """Whether the load cell under the contact is the fifth input, normal_force; the card then
    measures single-ended and loses a bit."""
    latency: Annotated[float, In("s"), Ge(0), Le(0.5)] = 8e-3
    """How long after its last sample a block can be had, on average."""
    jitter: Annotated[float, In("s"), Ge(0), Le(0.1)] = 3e-3
    """Mean of the exponential part of it, which ends at ten times its mean."""

    @property
    def inputs(self) -> int:
        """How many inputs are in use."""
        return len(_INPUTS) if self.load_cell else len(_INPUTS) - 1

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.median > self.block:
            raise wrong_entry(
                f"a median of {self.median} samples needs more than a block of {self.block}",
                "median",
            )
        if self.jitter > self.latency:
            raise wrong_entry(
                f"jitter {self.jitter:g} s is a part of latency {self.latency:g} s; "
                "it cannot be more",
                "jitter",
            )
        return self


class AngleDaq(BlockDriver[DaqConfig, AnglePlant]):
    """Gauges, potentiometers and, if wanted, the load cell; it measures only.

    A row is, for every input, its quantity and its volts (NAME_raw); then the card's own time
    (sample number over rate, in s) and the rate of its clock. The status word has bit i set if
    input i is at an end of its range. The quantities are by nominal scales, for people, interlocks
    and end conditions; an evaluation works from the volts and a calibration.
    """

    Config: ClassVar[type[DriverConfig]] = DaqConfig
    title: ClassVar[str] = "data acquisition card of the simulated approach-angle rig"
    on_plant: ClassVar[bool] = True

    def __init__(self, config: DaqConfig, link: AnglePlant) -> None:
        super().__init__(config, link)
        self._inputs = config.inputs
        self._card: Acquisition | None = None
        self._scale: NDArray[np.float64]
        self._zero: NDArray[np.float64]

    @classmethod
    def declare(cls, config: DaqConfig) -> Declaration:
        """Return the channels of every input, and the two of the card's clock."""
        names = layout.SIGNALS[: config.inputs]
        latest_s = config.latency + (LATEST_JITTER - 1.0) * config.jitter
        return Declaration(
            channels=(
                *(
                    channel
                    for name, (unit, doc) in zip(names, _INPUTS, strict=False)
                    for channel in (
                        Channel(name, unit, doc),
                        Channel(f"{name}_raw", "V", "at the card", -10.0, 10.0, raw_of=name),
                    )
                ),
                Channel("device_time", "s", "sample number over rate: the card's own clock"),
                Channel("clock_rate", "Hz", "rate of the card's clock"),
            ),
            has_status=True,
            status_bits={f"{name}_at_rail": 1 << k for k, name in enumerate(names)},
            silent_s=0.1 + 5 * config.block / config.rate + 5 * config.latency,
            rate_hz=config.rate,
            oldest_s=(config.block + 1) / config.rate + latest_s,
        )

    def open(self) -> None:
        """Take the nominal scales from the rig's drawing; nothing is sampled yet."""
        import numpy as np

        self.rate_hz = self.config.rate
        p = self.link.parameters
        gauge, slope = 1 / p.gauges.sensitivity, 1 / p.potentiometers.volts_per_rad
        pulley = p.potentiometers.pulley
        scale = (gauge, gauge, slope, slope * pulley, 1 / p.load_cell.sensitivity)
        wheel, platform = p.potentiometers.wheel_start, p.potentiometers.platform_start
        zero = (0.0, 0.0, wheel / slope, platform / (slope * pulley), 0.0)
        self._scale, self._zero = np.array(scale[: self._inputs]), np.array(zero[: self._inputs])
        self.identity = f"simulated card, serial number {self.link.config.individual:08X}"
        # Loads what samples, compiled: the cycle that starts the card must not wait for that.
        self._acquisition()

    def start(self) -> None:
        """Sample from the plant's present on."""
        self._card = self._acquisition()

    def _acquisition(self) -> Acquisition:
        from rigd_sim.approach_angle.acquisition import Acquisition

        return Acquisition(
            self.link,
            start_ns=self.link.now_ns,
            rate_hz=self.config.rate,
            block=self.config.block,
            load_cell=self.config.load_cell,
            latency_s=self.config.latency,
            jitter_s=self.config.jitter,
        )

    def read_block(self, timeout_s: float) -> Block | None:
        """Return the next block, None if the plant has not come so far; it never waits.

        Raises:
            DeviceError: no read came for so long that samples are lost.
            RuntimeError: it was not started.

        """
        if self._card is None:
            raise RuntimeError("start() comes before read_block()")
        try:
            samples = self._card.read()
        except OverflowError as error:
            raise DeviceError(str(error), hint="read the card in every cycle") from error
        if samples is None:
            return None
        return self._block(self._card, samples)

    def _block(self, card: Acquisition, samples: Samples) -> Block:
        import numpy as np

        volts = samples.volts
        count, inputs = volts.shape
        rows = np.zeros((count, 2 * inputs + 3))
        quantities = rows[:, 0 : 2 * inputs : 2]
        np.subtract(volts, self._zero, out=quantities)
        quantities *= self._scale
        rows[:, 1 : 2 * inputs : 2] = volts
        rows[:, -3] = np.arange(samples.first, samples.first + count) / self.rate_hz
        rows[:, -2] = self.rate_hz
        rail_v = RAIL * self.link.parameters.card.range
        if volts.max() >= rail_v or volts.min() <= -rail_v:
            rows[:, -1] = (np.abs(volts) >= rail_v) @ (1 << np.arange(inputs))
        return Block(card.times_ns(samples), rows)

    def newest_row(self, block: Block) -> Sequence[float]:
        """Return the last row, with the median of the last ``median`` samples for every input."""
        row = list(super().newest_row(block))
        count, width = self.config.median, 2 * self._inputs
        last = block.values[-count:, :width].copy()
        last.sort(axis=0)
        row[:width] = (0.5 * (last[(count - 1) // 2] + last[count // 2])).tolist()
        return row

    def close(self) -> None:
        """Stop sampling; closing twice is silent."""
        self._card = None
