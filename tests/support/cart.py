"""A cart on a spring for tests of the suite for plants: correct, with its devices."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar

from annotated_types import Gt, Le

from rigd.sdk import (
    Channel,
    Driver,
    Energy,
    GridPlant,
    In,
    PlantConfig,
    PlantSensor,
    Setting,
    accepted,
)
from rigd.sdk.check.plant_bench import Device
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


class Motor(Driver):
    """The motor; safe means without force."""

    title: ClassVar[str] = "motor of the cart"
    setpoints = (Channel("force", "N", "push", -20.0, 20.0),)
    link: Cart

    def open(self) -> None: ...
    def arm(self) -> None: ...
    def read(self, t_ns: int) -> None: ...

    def write(self, setpoints: Sequence[float]) -> None:
        self.link.force = accepted(self.setpoints[0], setpoints[0])

    def make_safe(self) -> None:
        self.link.force = 0.0


class Ruler(PlantSensor):
    """Position with noise, in steps of 10 um."""

    title: ClassVar[str] = "ruler along the cart"
    channels = (Channel("position", "m", "of the cart"),)
    link: Cart

    def read(self, t_ns: int) -> Sequence[float]:
        self.link.advance(t_ns)
        return (math.floor((self.link.state[0] + 1e-4 * self.link.noise()) * 1e5) * 1e-5,)


class Truth(PlantSensor):
    """Position and speed as they are."""

    title: ClassVar[str] = "hidden state of the cart"
    channels = (Channel("position", "m", "of the cart"), Channel("speed", "m/s", "of the cart"))
    link: Cart

    def read(self, t_ns: int) -> Sequence[float]:
        self.link.advance(t_ns)
        return self.link.state[:2]


DEVICES: dict[str, Device] = {"motor": (Motor, {}), "ruler": (Ruler, {}), "truth": (Truth, {})}
