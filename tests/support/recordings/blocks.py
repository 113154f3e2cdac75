"""A block device made of numbers, and what a test needs around it.

Helper processes import this module too: tests set PYTHONPATH for them.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

import numpy as np

from rigd.config.rig import DeviceConfig
from rigd.sdk import (
    Block,
    BlockDriver,
    Channel,
    Declaration,
    DeviceError,
    DriverConfig,
    LinkError,
    SlowDriver,
)

TESTS = Path(__file__).parents[2]
WAIT_S = 60.0  #: the machine may be busy; nothing here takes that long


class CounterConfig(DriverConfig):
    rows: int = 10
    """Rows of a block."""
    period: float = 0.005
    """Seconds between blocks."""
    blocks: int = 5
    """Good blocks before the fault."""
    fault: str = ""
    """What happens then."""


class Counter(BlockDriver[CounterConfig, None]):
    """Counts rows: channels number and half of it, the status word is the block's number."""

    Config: ClassVar[type[DriverConfig]] = CounterConfig
    title: ClassVar[str] = "counter of the tests"

    @classmethod
    def declare(cls, config: CounterConfig) -> Declaration:
        channels = (Channel("number"), Channel("half"))
        return Declaration(channels=channels, has_status=True, silent_s=0.5)

    def open(self) -> None:
        if self.config.fault == "absent":
            raise LinkError("nobody answers", hint="plug it in")
        self.identity, self.rate_hz = "counter 1", self.config.rows / self.config.period

    def start(self) -> None:
        if self.config.fault == "no start":
            raise DeviceError("it cannot sample", hint="lower its rate")
        if self.config.fault == "slow start":
            threading.Event().wait(0.3)
        self.count = self.number = 0
        self.t_ns = time.monotonic_ns()

    def read_block(self, timeout_s: float) -> Block | None:
        if self.number >= self.config.blocks and self.config.fault:
            return self.go_wrong(timeout_s)
        threading.Event().wait(self.config.period)
        return self.block()

    def block(self) -> Block:
        rows, start = self.config.rows, self.t_ns
        self.t_ns = max(time.monotonic_ns(), start + rows)
        self.number += 1
        times = np.linspace(start, self.t_ns, rows + 1)[1:].astype(np.int64)
        numbers = self.count + np.arange(rows, dtype=np.float64)
        self.count += rows
        status = np.full(rows, float(self.number))
        return Block(times, np.column_stack([numbers, numbers / 2, status]))

    def go_wrong(self, timeout_s: float) -> Block | None:
        match self.config.fault:
            case "overrun":
                raise DeviceError("samples were lost", hint="make the buffer larger")
            case "sticky":  # and close() fails as well
                raise DeviceError("the sensor is broken")
            case "bug":
                raise ZeroDivisionError("a bug in the driver")
            case "hang":
                while True:
                    threading.Event().wait(WAIT_S)
            case "quiet":
                threading.Event().wait(timeout_s)
                return None
            case "narrow":
                block = self.block()
                return Block(block.times_ns, block.values[:, :2])
            case "backwards":
                block = self.block()
                return Block(block.times_ns[::-1].copy(), block.values)
        raise AssertionError(self.config.fault)

    def close(self) -> None:
        if self.config.fault == "sticky":
            raise OSError("the port is gone")


def device_of(
    name: str, driver_class: type[BlockDriver | SlowDriver], config: DriverConfig
) -> DeviceConfig:
    """Return the device as a rig file would give it."""
    return DeviceConfig(
        name=name,
        driver=driver_class.__name__.lower(),
        driver_class=driver_class,
        config=config,
        declaration=driver_class.declare(config),
        limits={},
    )


def until(condition: Callable[[], bool], timeout_s: float = WAIT_S) -> None:
    """Wait for something that only another process can bring about."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(f"not within {timeout_s:g} s")
        threading.Event().wait(0.005)


def alive(pid: int) -> bool:
    """Return whether a process runs; one that waits to be reaped does not."""
    try:
        os.kill(pid, 0)
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (ProcessLookupError, FileNotFoundError):
        return False
    return state != "Z"
