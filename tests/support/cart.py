"""A cart on a spring for tests of the suite for plants: correct, with its devices."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar

from annotated_types import Gt, Le

from rigd.sdk import (
    Channel,
    Declaration,
    Driver,
    DriverConfig,
    Energy,
    GridPlant,
    In,
    PlantConfig,
    PlantSensor,
    Row,
    Setting,
    accepted,
)
from rigd.sdk.check.plant.bench import Device
from rigd.sdk.noise import normal_pair


class CartConfig(PlantConfig):
    """The cart."""

    mass: Annotated[float, In("kg"), Gt(0), Le(10)] = 2.0
    """Mass of the cart."""
    floor: str = "dry"
    """Floor at the start."""

    def settings(self) -> Mapping[str, Setting]:
        return {
            "floor": Setting("floor under the cart", ("dry", "oiled")),
            "mass": Setting("mass of the cart", unit="kg", low=0.5, high=10.0),
        }


class Cart(GridPlant):
    """A cart between a spring and a damper, pushed by a motor."""

    Config: ClassVar[type[PlantConfig]] = CartConfig
    title: ClassVar[str] = "cart on a spring"
    order: ClassVar[int] = 2
    config: CartConfig
    stiffness = 200.0
    damping: ClassVar[Mapping[str, float]] = {"dry": 8.0, "oiled": 2.0}

    def __init__(self, config: CartConfig, *, period_ns: int, seed: int) -> None:
        super().__init__(config, period_ns=period_ns, seed=seed)
        self.force = 0.0
        self.floor, self.mass = config.floor, config.mass
        #: Position in m, speed in m/s, energy in J that the motor gave and that the damper took.
        self.state = (0.0, 0.0, 0.0, 0.0)

    def rates(self, state: Sequence[float]) -> tuple[float, ...]:
        x, v = state[:2]
        drag = self.damping[self.floor] * v
        rate = (self.force - drag - self.stiffness * x) / self.mass
        return v, rate, self.force * v, drag * v

    def step(self, step_s: float) -> None:
        half = zip(self.state, self.rates(self.state), strict=True)
        middle = [value + 0.5 * step_s * rate for value, rate in half]
        whole = zip(self.state, self.rates(middle), strict=True)
        x, v, supplied, dissipated = (value + step_s * rate for value, rate in whole)
        self.state = x, v, supplied, dissipated

    def apply(self, quantity: str, value: float | str) -> None:
        if quantity == "floor":
            self.floor = str(value)
        else:
            self.mass = float(value)

    def energy(self) -> Energy | None:
        x, v, supplied, dissipated = self.state
        stored = 0.5 * self.mass * v * v + 0.5 * self.stiffness * x * x
        return Energy(stored, supplied, dissipated)

    def noise(self) -> float:
        return normal_pair(self.seed, self.now_ns - self.origin_ns)[0]


class Motor(Driver[DriverConfig, Cart]):
    """The motor; safe means without force."""

    title: ClassVar[str] = "motor of the cart"

    @classmethod
    def declare(cls, config: DriverConfig) -> Declaration:
        return Declaration(setpoints=(Channel("force", "N", "push", -20.0, 20.0),))

    def open(self) -> None: ...
    def arm(self) -> None: ...
    def read(self, t_ns: int) -> None: ...

    def write(self, setpoints: Sequence[float]) -> None:
        self.link.force = accepted(self.declaration.setpoints[0], setpoints[0])

    def make_safe(self) -> None:
        self.link.force = 0.0


class RulerRow(Row):
    position: float


class Ruler(PlantSensor[DriverConfig, Cart]):
    """Position with noise, in steps of 10 um."""

    title: ClassVar[str] = "ruler along the cart"

    @classmethod
    def declare(cls, config: DriverConfig) -> Declaration:
        return Declaration(channels=(Channel("position", "m", "of the cart"),), row=RulerRow)

    def read(self, t_ns: int) -> RulerRow:
        self.link.advance(t_ns)
        position = self.link.state[0] + 1e-4 * self.link.noise()
        return RulerRow.of(position=math.floor(position * 1e5) * 1e-5)


class TruthRow(Row):
    position: float
    speed: float


class Truth(PlantSensor[DriverConfig, Cart]):
    """Position and speed as they are."""

    title: ClassVar[str] = "hidden state of the cart"

    @classmethod
    def declare(cls, config: DriverConfig) -> Declaration:
        position = Channel("position", "m", "of the cart")
        speed = Channel("speed", "m/s", "of the cart")
        return Declaration(channels=(position, speed), row=TruthRow)

    def read(self, t_ns: int) -> TruthRow:
        self.link.advance(t_ns)
        position, speed, *_ = self.link.state
        return TruthRow.of(position=position, speed=speed)


DEVICES: dict[str, Device] = {"motor": (Motor, {}), "ruler": (Ruler, {}), "truth": (Truth, {})}
