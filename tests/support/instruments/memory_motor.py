"""A motor in memory, and a driver of it without a mistake: the suite's tests add one each."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, ClassVar

from annotated_types import Gt, Le
from support.instruments.memory_wire import Wire

from rigd.sdk import (
    Channel,
    Declaration,
    DeviceError,
    Driver,
    DriverConfig,
    In,
    Link,
    LinkConfig,
    LinkError,
    Row,
)
from rigd.sdk.check import Peer


class MotorWire(Wire):
    """A motor in memory."""

    speed = 0.0


class WireLink(Link):
    """The way to a motor in memory."""

    def __init__(self, wire: MotorWire) -> None:
        super().__init__(LinkConfig())
        self.wire = wire
        self.ours = False

    def open(self) -> None:
        if self.wire.fault == "dead":
            raise LinkError("nothing is connected", hint="plug it in")
        if self.wire.taken:
            raise LinkError("somebody has it", hint="end the other session")
        self.wire.taken = self.ours = True

    def close(self) -> None:
        if self.ours:
            self.wire.taken = self.ours = False


@contextmanager
def motor() -> Iterator[Peer]:
    wire = MotorWire()
    yield wire.peer(lambda: WireLink(wire))


class MotorConfig(DriverConfig):
    """A motor in memory."""

    speed_range: Annotated[float, In("m/s"), Gt(0), Le(9)] = 2.0
    """Largest speed of either sign."""


class MotorRow(Row):
    speed: float
    load: float
    status: int


class Good(Driver[MotorConfig, WireLink]):
    """A motor in memory; safe means standing still."""

    Config: ClassVar[type[DriverConfig]] = MotorConfig
    title: ClassVar[str] = "motor in memory"
    second_link: ClassVar[bool] = True

    @classmethod
    def declare(cls, config: MotorConfig) -> Declaration:
        top = config.speed_range
        return Declaration(
            channels=(
                Channel("speed", "m/s", "speed", -9.0, 9.0),
                Channel("load", "N", "load", 10.0, 90.0),
            ),
            row=MotorRow,
            status_bits={"moving": 1},
            setpoints=(Channel("speed", "m/s", "speed", -top, top),),
            watchdog_s=0.05,
        )

    def open(self) -> None:
        """Open."""

    def prove_watchdog(self) -> float:
        """Prove it."""
        return 0.05

    def arm(self) -> None:
        """Arm."""

    def read(self, t_ns: int) -> Sequence[float] | None:
        """Read."""
        if self.link.wire.fault == "dead":
            raise LinkError("the motor is gone")
        return None if self.link.wire.fault else self.row()

    def row(self) -> MotorRow:
        return MotorRow.of(speed=self.link.wire.speed, load=50.0, status=1)

    def write(self, setpoints: Sequence[float]) -> None:
        """Write."""
        (speed,) = setpoints
        if math.isnan(speed):
            raise DeviceError("speed is NaN")
        (channel,) = self.declaration.setpoints
        self.link.wire.speed = min(max(speed, channel.low), channel.high)

    def make_safe(self) -> None:
        """Stand still, which is the safe state."""
        self.link.wire.speed = 0.0

    def rescue(self) -> None:
        """Stand still over a link of its own."""
        self.link.open()
        self.make_safe()
        self.link.close()
