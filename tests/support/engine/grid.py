"""A block device whose samples lie on a fixed grid, so that a test knows every one of them.

Helper processes import this module too: tests set PYTHONPATH for them.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from rigd.config.rig import DeviceConfig, PlantSetup, RigConfig, SourceFile, Supervision
from rigd.model.limits import Interlock
from rigd.sdk import Block, BlockDriver, Channel, Declaration, DriverConfig, Plant, PlantConfig
from rigd.sdk.driver import LinkT

PERIOD_NS = 2_000_000  #: of the cycle


class GridConfig(DriverConfig):
    rows: int = 10
    """Rows of a block."""
    row_ns: int = 500_000
    """Between two rows."""
    latency_ns: int = 3_000_000
    """A block can be had so long after its last row."""
    blocks: int = 1_000_000
    """Blocks before it falls silent."""
    seen: int = -1
    """Which row of a block the cycle sees."""
    ahead_ns: int = 0
    """How far its times are ahead: a mistake."""


class Grid(BlockDriver[GridConfig, LinkT]):
    """Row k has the number k, and was taken k * row_ns after the start."""

    Config: ClassVar[type[DriverConfig]] = GridConfig
    title: ClassVar[str] = "grid of the tests"

    @classmethod
    def declare(cls, config: GridConfig) -> Declaration:
        channels = (Channel("number"), Channel("negative"))
        return Declaration(channels=channels, has_status=True, silent_s=1.0)

    def open(self) -> None:
        self.rate_hz = 1e9 / self.config.row_ns

    def start(self) -> None:
        self.begun_ns = self.now_ns()
        self.next = 0

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def read_block(self, timeout_s: float) -> Block | None:
        config, first = self.config, self.next
        if first >= config.blocks * config.rows:
            threading.Event().wait(timeout_s)
            return None
        numbers = np.arange(first, first + config.rows)
        times_ns = self.begun_ns + numbers * config.row_ns
        missing_s = (int(times_ns[-1]) + config.latency_ns - self.now_ns()) * 1e-9
        if missing_s > timeout_s:
            threading.Event().wait(timeout_s)
            return None
        threading.Event().wait(max(missing_s, 0.0))
        self.next += config.rows
        values = np.column_stack([numbers, -numbers, numbers % 7]).astype(np.float64)
        return Block(times_ns + config.ahead_ns, values)

    def newest_row(self, block: Block) -> Sequence[float]:
        row: list[float] = block.values[self.config.seen].tolist()
        return row


class ClockPlant(Plant):
    """Physics that are nothing but the time."""

    t_ns = 0

    def evolve(self, t_ns: int, elapsed_ns: int) -> None:
        self.t_ns = self.origin_ns + t_ns


class PlantGrid(Grid[ClockPlant]):
    """The same, on a plant."""

    on_plant: ClassVar[bool] = True

    def now_ns(self) -> int:
        return self.link.t_ns


def rig(
    driver: type[Grid],
    path: Path,
    *,
    interlocks: tuple[Interlock, ...] = (),
    **options: object,
) -> RigConfig:
    """Return a rig of this one device, ``grid``."""
    config = GridConfig.model_validate(options)
    return RigConfig(
        name=f"grid-{path.name}",
        title="",
        period_ns=PERIOD_NS,
        plant=PlantSetup("clock", ClockPlant, PlantConfig()) if driver.on_plant else None,
        devices={
            "grid": DeviceConfig(
                name="grid",
                driver="grid",
                driver_class=driver,
                config=config,
                declaration=driver.declare(config),
                limits={},
            )
        },
        interlocks=interlocks,
        constants={},
        source=SourceFile(path, "rig: grid\n"),
        supervision=Supervision(0.5, 2.0),
    )
