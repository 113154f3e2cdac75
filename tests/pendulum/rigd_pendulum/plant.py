"""The pendulum: I d2q/dt2 = -G sin(q) - T_c sgn(dq/dt) - b dq/dt, held by a clamp or free."""

from __future__ import annotations

import math
import random
from typing import Annotated, ClassVar

from annotated_types import Ge, Gt

from rigd.sdk import GridPlant, In, PlantConfig

#: How fast the clamp takes the pendulum to its angle.
CLAMP_RAD_S = 3.0


class PendulumConfig(PlantConfig):
    """The hidden truth, and the resolution of the encoder."""

    inertia: Annotated[float, In("kg m^2"), Gt(0)] = 0.02
    """About the axis."""
    weight_moment: Annotated[float, In("N m"), Gt(0)] = 0.981
    """Weight times the distance of the centre of mass from the axis."""
    coulomb: Annotated[float, In("N m"), Ge(0)] = 0.01
    """Torque of dry friction."""
    viscous: Annotated[float, In("N m s/rad"), Ge(0)] = 0.002
    """Torque of friction per angular speed."""
    noise: Annotated[float, In("rad"), Ge(0)] = 5e-5
    """Standard deviation of the encoder."""


class PendulumPlant(GridPlant):
    """Physics and encoder of the pendulum."""

    Config: ClassVar[type[PlantConfig]] = PendulumConfig
    title: ClassVar[str] = "pendulum with Coulomb and viscous friction"
    step_ns: ClassVar[int] = 250_000
    config: PendulumConfig

    def __init__(self, config: PendulumConfig, *, period_ns: int, seed: int) -> None:
        super().__init__(config, period_ns=period_ns, seed=seed)
        self.clamped = True
        self.clamp_at = 0.0
        self.angle = 0.0
        self.speed = 0.0
        self._random = random.Random(seed)

    def shown(self) -> float:
        """Return the angle with the noise of the encoder, in rad."""
        return self.angle + self._random.gauss(0.0, self.config.noise)

    def step(self, step_s: float) -> None:
        """Integrate over one step, in s."""
        if self.clamped:
            far = CLAMP_RAD_S * step_s
            self.angle += min(max(self.clamp_at - self.angle, -far), far)
            self.speed = 0.0
            return
        # Velocity Verlet: the energy of the swing does not drift.
        half = self.speed + 0.5 * step_s * self._acceleration(self.angle, self.speed)
        self.angle += step_s * half
        self.speed = half + 0.5 * step_s * self._acceleration(self.angle, half)

    def _acceleration(self, angle: float, speed: float) -> float:
        config = self.config
        weight = -config.weight_moment * math.sin(angle)
        drag = math.copysign(config.coulomb, speed) if speed else 0.0
        return (weight - drag - config.viscous * speed) / config.inertia
