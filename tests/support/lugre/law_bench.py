"""The small rig of :mod:`support.lugre.bench` on floors that follow other friction laws.

Plain explicit steps of 2.5 µs, in which each law is a line or two: no code of the shipped laws.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from support.lugre.bench import RADIUS_M, Bench

from rigd.model.machine.kernel import kernel

FloatArray = NDArray[np.float64]

STEP_S: Final = 2.5e-6
ELEMENTS: Final = 4
DAHL, MAGIC, ROLLING, MAXWELL = range(4)


@dataclass(frozen=True)
class Surface:
    """A law by its number, and its parameters in the order of the equations below."""

    law: int
    parameters: tuple[float, ...]


#: mu, sigma_0, sigma_2; D, C, B, E; V_s, mu_c, mu_s, sigma_0, sigma_1, sigma_2, kappa; and V_s,
#: mu_c, mu_s, stiffness of each element, attraction, sigma_2.
SURFACES: Final = {
    "dahl-viscous": Surface(DAHL, (0.11, 45.0, 2.6)),
    "magic-formula": Surface(MAGIC, (0.32, 1.5, 35.0, -0.4)),
    "lugre-rolling": Surface(ROLLING, (0.01, 0.09, 0.12, 45.0, 0.4, 2.5, 12.0)),
    "maxwell-slip": Surface(
        MAXWELL, (0.01, 0.09, 0.13, 1.0, 4.0, 16.0, 64.0, 20.0, 2.2),
    ),
}  # fmt: skip


@kernel
def _g(slip: float, v_s: float, low: float, high: float) -> float:
    return float(low + (high - low) * np.exp(-np.sqrt(abs(slip) / v_s)))


@kernel
def _force(
    law: int, q: FloatArray, z: FloatArray, stuck: FloatArray, slip: float, rim: float
) -> float:
    """Return F/F_N, and move the memory ``z`` of the contact by one step."""
    if law == DAHL:
        z[0] += STEP_S * q[1] * (slip - abs(slip) * z[0] / q[0])
        return float(z[0] + q[2] * slip)
    if law == MAGIC:
        x = q[2] * slip
        return float(q[0] * np.sin(q[1] * np.arctan(x - q[3] * (x - np.arctan(x)))))
    g = _g(slip, q[0], q[1], q[2])
    if law == ROLLING:
        bending = slip - q[3] * abs(slip) * z[0] / g - q[6] * abs(rim) * z[0]
        z[0] += STEP_S * bending
        return float(q[3] * z[0] + q[4] * bending + q[5] * slip)
    total = q[8] * slip
    sign = np.sign(slip)
    for i in range(ELEMENTS):
        if stuck[i] == 0.0 and sign * z[i] < 0.0:
            stuck[i] = 1.0  # the slip has reversed
        if stuck[i] == 1.0:
            z[i] += STEP_S * q[3 + i] * slip
            if sign * z[i] >= g / ELEMENTS:
                z[i], stuck[i] = sign * g / ELEMENTS, 0.0
        else:
            z[i] += STEP_S * sign * q[7] * (1.0 / ELEMENTS - z[i] / (sign * g))
        total += z[i]
    return float(total)


@kernel
def _drive(
    law: int, q: FloatArray, mass: float, rolling: float, ripple: float,
    current: float, rest_s: float, longest_s: float, after_s: float, dt: float,
) -> FloatArray:  # fmt: skip
    count, each = round((longest_s + after_s) / dt), round(dt / STEP_S)
    rows = np.zeros((count, 9))
    v = w = i = x = theta = 0.0
    z, stuck = np.zeros(ELEMENTS), np.ones(ELEMENTS)
    normal = mass * 9.81
    inertia = 4.5e-4 + 1.2e-6 * 0.81 * 20.25**2
    left, n = round(after_s / dt), 0
    while n < count and left > 0:
        braking = x > 1.15 or n * dt >= longest_s
        left -= braking
        for part in range(each):
            command = current if n * dt >= rest_s and not braking else 0.0
            slip = RADIUS_M * w - v
            force = normal * _force(law, q, z, stuck, slip, RADIUS_M * w)
            sv, sw = np.tanh(v / 1e-3), np.tanh(RADIUS_M * w / 1e-3)
            guide = 0.01956708695 * sv * normal * 0.012 / 0.030
            shake = mass * ripple * v * np.sin(18.0 * theta)
            brake = 15.0 * sv if braking else 0.0
            a = (force - guide - rolling * normal * sv + shake - brake) / mass
            if part == 0:
                rows[n, :5] = np.array((n * dt, v, w, z[0], i))
                rows[n, 5:] = np.array((x, theta, a, 1.0 * braking))
            bearing = (0.002 * sw + 2e-5 * w) * normal * (0.07 + 0.03) / 0.04 * 0.01
            idle = 2.2e-3 * sw + 1.9e-6 * 20.25 * w
            torque = (0.0295 * i - idle) * 0.81 * 20.25
            back = 0.0295 * 20.25 * w
            reference = min(max(command, (-24.0 - back) / 3.2), (24.0 - back) / 3.2)
            x, theta = x + STEP_S * v, theta + STEP_S * w
            v += STEP_S * a
            w += STEP_S * (torque - bearing - RADIUS_M * force) / inertia
            i += STEP_S * 2.0 * np.pi * 1000.0 * (reference - i)
        n += 1
    return rows[:n]


@dataclass(frozen=True)
class LawBench(Bench):
    """Makes trials of the rig on the surface ``law``; ``floor`` only gives rolling resistance."""

    law: str = "dahl-viscous"

    def rows(self, current_a: float) -> FloatArray:
        """Return (n, 9) as the base class does; the memory of the contact in place of p."""
        surface = SURFACES[self.law]
        return _drive(
            surface.law, np.array(surface.parameters), self.mass_kg, self.truth.mu_rol,
            0.3 * self.noisy, current_a, 0.35, self.max_s, 0.1, self.dt_s,
        )  # fmt: skip
