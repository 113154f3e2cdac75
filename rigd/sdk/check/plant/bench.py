"""Runs a plant and its simulated devices in the order of the control cycle, without a rig.

In each cycle the module advances the plant, reads the devices and writes their setpoints. There are
no limits and no interlocks.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rigd.model.errors import RigdError
from rigd.sdk.check.subject import UnfitSubject, described
from rigd.sdk.driver import BlockDriver, Driver
from rigd.sdk.plant import Energy, Plant, PlantConfig

#: Time between two readings of the devices, and between two calls of advance(), in ns.
CYCLE_NS: Final = 1_000_000
#: How long the plant is driven, in cycles.
CYCLES: Final = 800

#: ``commands(device, cycle)``: the setpoints of a device in a cycle.
Commands = Callable[[Driver, int], Sequence[float]]
#: A device that stands on the plant: its driver and its options as a rig file gives them.
Device = tuple[type[Any], Mapping[str, Any]]


@dataclass(frozen=True)
class PlantSubject:
    """The plant to which the rules are applied."""

    plant_class: type[Plant]
    options: Mapping[str, Any]
    devices: Mapping[str, Device]
    #: Name of the device that shows the hidden state; "" if there is none.
    truth: str
    #: Share by which the energy may fail to balance, and a halved step may change the truth.
    accuracy: float
    #: What is drawn at random is drawn from it.
    seed: int = 1

    def config(self) -> PlantConfig:
        """Return the options, read."""
        return self.plant_class.Config.model_validate(dict(self.options))

    def make(self, *, seed: int = 1, step_ns: int | None = None) -> Plant:
        """Return a new plant; ``step_ns`` replaces the step of its class."""
        kind = self.plant_class
        if step_ns is not None:
            kind = type(kind.__name__, (kind,), {"step_ns": step_ns})
        return kind(self.config(), period_ns=CYCLE_NS, seed=seed)


@dataclass
class Played:
    """The observations: rows by device, energy by cycle, and how the cycles ended."""

    rows: dict[str, list[Sequence[float]]] = field(default_factory=dict)
    energy: list[Energy] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)

    def bytes(self) -> bytes:
        """Return all rows, bit for bit."""
        return b"".join(self.table(name).tobytes() for name in self.rows)

    def table(self, name: str) -> NDArray[np.float64]:
        """Return the rows of a device, shape (rows, columns)."""
        return np.array(self.rows[name], dtype=np.float64)


class PlantBench:
    """A plant with its devices opened and armed."""

    def __init__(
        self,
        subject: PlantSubject,
        plant: Plant,
        *,
        start_ns: int = 0,
        rng: random.Random | None = None,
    ) -> None:
        """Open and arm the devices; with ``rng`` they are read in an order at random.

        Raises:
            UnfitSubject: they cannot be armed.
        """
        self.plant = plant
        self._rng = rng
        self._written: dict[str, Sequence[float]] = {}
        self.seen = Played()
        self._start_ns = start_ns
        self._cycle = 0
        self._drivers: dict[str, Driver] = {}
        self._blocks: dict[str, BlockDriver] = {}
        try:
            plant.advance(start_ns)
            for name, (driver_class, options) in subject.devices.items():
                self._mount(name, driver_class, options)
            for driver in self._drivers.values():
                driver.open()
                driver.arm()
            for block in self._blocks.values():
                block.open()
                block.start()
        except Exception as error:
            raise UnfitSubject(f"its devices cannot be armed: {described(error)}") from error
        self.seen.rows = {name: [] for name in subject.devices}

    def _mount(self, name: str, driver_class: type[Any], options: Mapping[str, Any]) -> None:
        config = driver_class.Config.model_validate(
            dict(options), context={"plant": self.plant.config}
        )
        driver = driver_class(config, self.plant)
        if isinstance(driver, Driver):
            self._drivers[name] = driver
        elif isinstance(driver, BlockDriver) and driver.on_plant:
            self._blocks[name] = driver
        else:
            raise TypeError(f"{name} does not stand on a plant")

    @property
    def now_ns(self) -> int:
        """The time of the last cycle."""
        return self._start_ns + self._cycle * CYCLE_NS

    @property
    def devices(self) -> Mapping[str, Driver | BlockDriver]:
        """The devices on the plant, by name."""
        return {**self._drivers, **self._blocks}

    def touch(self, t_ns: int) -> None:
        """Do at a time what changes nothing: advance, read a device, write what was written."""
        rng = self._rng or random.Random()
        steps: list[Callable[[], object]] = [partial(self.plant.advance, t_ns)] * 2
        for name, driver in self._drivers.items():
            if driver.declaration.every_cycle:
                steps.append(partial(driver.read, t_ns))
            if name in self._written:
                steps.append(partial(driver.write, self._written[name]))
        for step in rng.sample(steps, rng.randint(1, len(steps))):
            with suppress(RigdError):
                step()

    def play(self, cycles: int, commands: Commands | None, *, at_once: int = 1) -> Played:
        """Play ``cycles`` cycles and return everything observed so far.

        Devices are read, and setpoints change, in every cycle of which ``at_once`` is a factor; a
        single call advances the plant to that time.
        """
        for _ in range(cycles // at_once):
            self._cycle += at_once
            self._exchange(commands)
        return self.seen

    def make_safe(self) -> None:
        """Make every device safe; no commands follow."""
        for driver in self._drivers.values():
            driver.make_safe()

    def look(self) -> None:
        """Take the rows of the moment."""
        names = list(self._drivers)
        if self._rng is not None:
            self._rng.shuffle(names)
        for name in names:
            row = self._drivers[name].read(self.now_ns)
            if row is not None:
                self.seen.rows[name].append(tuple(row))
        self.plant.advance(self.now_ns)
        for name, block in self._blocks.items():
            while (got := block.read_block(0.0)) is not None:
                self.seen.rows[name] += got.values.tolist()
        energy = self.plant.energy()
        if energy is not None:
            self.seen.energy.append(energy)

    def _exchange(self, commands: Commands | None) -> None:
        try:
            if self._rng is None:  # else the device that is read first does it
                self.plant.advance(self.now_ns)
            self.look()
        except Exception as error:
            raise UnfitSubject(f"cycle {self._cycle} raises {described(error)}") from error
        if commands is None:
            return
        for name, driver in self._drivers.items():
            if not driver.declaration.setpoints:
                continue
            values = self._written[name] = commands(driver, self._cycle)
            try:
                driver.write(values)
            except RigdError as error:
                self.seen.refused.append(f"{name}: {error}")
            except Exception as error:
                raise UnfitSubject(f"{name}.write() raises {described(error)}") from error


def gentle(driver: Driver, cycle: int) -> Sequence[float]:
    """Return setpoints within the middle four fifths of their ranges, each at a pace of its own."""
    turns = 2 * math.pi * cycle * CYCLE_NS * 1e-9
    return [
        0.5 * (each.low + each.high)
        + 0.4 * (each.high - each.low) * math.sin((0.9 + 0.7 * number) * turns)
        for number, each in enumerate(driver.declaration.setpoints)
    ]


def mirrored(driver: Driver, cycle: int) -> Sequence[float]:
    """Return the setpoints of :func:`gentle`, mirrored at the middle of their ranges."""
    return [
        setpoint.low + setpoint.high - value
        for setpoint, value in zip(driver.declaration.setpoints, gentle(driver, cycle), strict=True)
    ]


def strong(driver: Driver, cycle: int) -> Sequence[float]:
    """Return setpoints that stay at the low ends of their ranges, then at the high ones."""
    end = (cycle // CYCLES) % 2
    return [(setpoint.low, setpoint.high)[end] for setpoint in driver.declaration.setpoints]


def wild(driver: Driver, cycle: int) -> Sequence[float]:
    """Return setpoints that jump from end to end of their ranges, far beyond them, and to NaN."""
    turn = cycle // 20
    values = []
    for number, setpoint in enumerate(driver.declaration.setpoints):
        far = 1e6 * (setpoint.high - setpoint.low)
        low, high = setpoint.low, setpoint.high
        jumps = (high, low, far, low, -far, high, math.inf, -math.inf, math.nan)
        values.append(jumps[(turn + number) % len(jumps)])
    return values
