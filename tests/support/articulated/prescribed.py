"""The chain of modules by Lagrange multipliers, its motors' speeds prescribed, free wheels rolling.

Beside the constraints of :class:`support.articulated.multipliers.Multipliers`, a wheel with a motor
turns as it is told, and one without rolls on the ground: two more kinds of rows. Each wheel bears a
quarter of its module's own weight, and no contact slides.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from support.articulated.multipliers import Multipliers

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Prescribed(Multipliers):
    """The robot of ``parameters``; ``spinning`` (4 n,) are the wheels' accelerations in rad/s^2."""

    law: str = "linear"
    spinning: Array = field(default_factory=lambda: np.zeros(0))

    def driven(self, j: int, k: int) -> bool:
        return self.modules[j].wheels.driven in ("all", "front" if k < 2 else "rear")

    def constraints(self, q: Array, v: Array) -> tuple[Array, Array]:
        n = len(self.modules)
        paper, rates = super().constraints(q, v)
        paper, rates = paper[: 8 * n + 2 * (n - 1)], rates[: 8 * n + 2 * (n - 1)]  # no gears
        rows, more = list(paper), list(rates)
        for j, module in enumerate(self.modules):
            for k in range(4):
                rho, _, phi = self.wheel(j, k)
                row = np.zeros(len(q))
                row[phi] = 1.0
                if self.driven(j, k):
                    more.append(-self.spinning[4 * j + k])
                else:
                    row[phi], row[rho] = module.wheels.radius, -1.0
                    more.append(0.0)
                rows.append(row)
        return np.array(rows), np.array(more)

    def forces(self, v: Array, torques: Array) -> Array:
        found = super().forces(v, torques)
        for j, module in enumerate(self.modules):
            wheels = module.wheels
            load = self.parameters.gravity * (module.body_mass + 4 * wheels.mass) / 4
            for k in range(4):
                rho, _, phi = self.wheel(j, k)
                slip = wheels.radius * v[phi] - v[rho]
                along = module.contact.longitudinal * slip if self.driven(j, k) else 0.0
                found[rho] = along + wheels.mass * v[rho + 4 * len(self.modules)] * v[3 * j + 2]
                sign = np.tanh(v[phi] / self.parameters.friction.rest_speed)
                rolling = module.contact.rolling * load * sign
                found[phi] = torques[4 * j + k] - wheels.radius * along - rolling
        return found
