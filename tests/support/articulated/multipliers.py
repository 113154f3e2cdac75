"""The articulated robot a second time: the paper's 30 coordinates with Lagrange multipliers.

It shares no equation with the plant. Coordinates are those of Table 1 of "Modelling and
experimental validation of articulated mobile robots with hybrid locomotion system": (x, y, theta)
of each module, then rho, eta and phi of all wheels; for two modules they are 30, with the 18
constraints of Eqs. 1 to 5. Eqs. 7 to 12 are taken with the corrections of `articulated.md` 1: the
sign of the first term of Eq. 9 follows from A^T R, contact forces stand beside the torques.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, hypot, sin, tanh

import numpy as np
from numpy.typing import NDArray

from rigd_sim.articulated.parameters import ArticulatedParameters, Module

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Multipliers:
    """The robot of ``parameters`` under one of the laws, with equal loads."""

    parameters: ArticulatedParameters
    law: str = "paper"

    @property
    def modules(self) -> list[Module]:
        return list(self.parameters.modules.values())

    def wheel(self, j: int, k: int) -> tuple[int, int, int]:
        """Return the numbers of rho, eta and phi of wheel k = 0 to 3 of module j."""
        n = len(self.modules)
        first = 3 * n + 4 * j + k
        return first, first + 4 * n, first + 8 * n

    def mass(self) -> Array:
        """Return the diagonal of M; a rotor counts with the wheels that it turns."""
        n = len(self.modules)
        diagonal = np.zeros(15 * n)
        for j, module in enumerate(self.modules):
            wheels, drive = module.wheels, module.drive or self.parameters.drive
            yaw = module.body_inertia + 4 * wheels.yaw_inertia
            diagonal[3 * j : 3 * j + 3] = module.body_mass, module.body_mass, yaw
            rotor = drive.gear_ratio**2 * drive.rotor_inertia
            for k in range(4):
                rho, eta, phi = self.wheel(j, k)
                diagonal[rho] = diagonal[eta] = wheels.mass
                diagonal[phi] = wheels.spin_inertia
                if wheels.driven == "all":
                    diagonal[phi] += rotor / (2 if wheels.pairing == "geared" else 1)
                elif wheels.driven == ("front" if k < 2 else "rear"):
                    diagonal[phi] += rotor
        return diagonal

    def constraints(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return A(q), and A' q'; the gears of paired wheels are rows behind those of the paper."""
        rows: list[Array] = []
        rates: list[float] = []
        size = len(q)
        for j, module in enumerate(self.modules):
            x, y, th = 3 * j, 3 * j + 1, 3 * j + 2
            c, s, w = cos(q[th]), sin(q[th]), v[th]
            b, d = module.half_track, module.half_wheelbase
            for k in range(4):
                rho, eta, _ = self.wheel(j, k)
                row = np.zeros(size)  # Eq. 1
                row[rho], row[x], row[y], row[th] = 1.0, -c, -s, (-1.0) ** (k + 1) * b
                rows.append(row)
                rates.append(w * (s * v[x] - c * v[y]))
                row = np.zeros(size)  # Eqs. 2, 3
                row[eta], row[x], row[y], row[th] = 1.0, s, -c, -d if k < 2 else d
                rows.append(row)
                rates.append(w * (c * v[x] + s * v[y]))
        for j in range(1, len(self.modules)):  # Eqs. 4, 5
            ahead, module = self.modules[j - 1], self.modules[j]
            first, last = 3 * (j - 1), 3 * j
            lever = ((first + 2, ahead.hinge_behind), (last + 2, module.hinge_ahead))
            row, other = np.zeros(size), np.zeros(size)
            row[last], row[first] = 1.0, -1.0
            other[last + 1], other[first + 1] = 1.0, -1.0
            along, across = 0.0, 0.0
            for th, length in lever:
                row[th], other[th] = -length * sin(q[th]), length * cos(q[th])
                along -= length * cos(q[th]) * v[th] ** 2
                across -= length * sin(q[th]) * v[th] ** 2
            rows += [row, other]
            rates += [along, across]
        for j, module in enumerate(self.modules):
            for k in (0, 1) if module.wheels.pairing == "geared" else ():
                row = np.zeros(size)
                row[self.wheel(j, k)[2]], row[self.wheel(j, k + 2)[2]] = 1.0, -1.0
                rows.append(row)
                rates.append(0.0)
        return np.array(rows), np.array(rates)

    def contact(self, module: Module, slip: float, eta: float) -> tuple[float, float]:
        """Return f_lon and f_lat by Eq. 20, read as in articulated.md 1.3."""
        friction, own = self.parameters.friction, module.contact
        static = friction.static if own.static is None else own.static
        kinetic = friction.kinetic if own.kinetic is None else own.kinetic
        along, across = module.contact.longitudinal * slip, -module.contact.lateral * eta
        trial, load = hypot(along, across), self.load
        limit = static * load
        factor = 1.0
        if self.law == "paper" and trial > limit:
            factor = kinetic * load / trial
        if self.law == "smooth":
            t = (trial / limit - 1.0 + friction.width) / (2 * friction.width)
            t = min(max(t, 0.0), 1.0)
            blend = 6 * t**5 - 15 * t**4 + 10 * t**3
            factor = (1.0 - blend) + (blend * kinetic * load / trial if blend else 0.0)
        return factor * along, factor * across

    @property
    def load(self) -> float:
        masses = sum(module.body_mass + 4 * module.wheels.mass for module in self.modules)
        return self.parameters.gravity * masses / (4 * len(self.modules))

    def stops(self, q: Array, v: Array) -> Array:
        """Return the moments of the hinges' stops on the headings, by articulated.md 8."""
        found = np.zeros(len(v))
        for j, module in enumerate(self.modules[1:]):
            hinge, ahead, behind = module.hinge or self.parameters.hinge, 3 * j + 2, 3 * j + 5
            angle, rate = q[ahead] - q[behind], v[ahead] - v[behind]
            beyond, outward = abs(angle) - hinge.stop, np.sign(angle) * rate
            moment = hinge.stiffness * beyond * (1.0 + hinge.damping * outward)
            if beyond > 0.0:
                found[ahead] -= np.sign(angle) * max(moment, 0.0)
                found[behind] += np.sign(angle) * max(moment, 0.0)
        return found

    def forces(self, v: Array, torques: Array) -> Array:
        """Return B tau - C - f; ``torques`` is that on each wheel in N m, in the order of phi."""
        found = np.zeros(len(v))
        for j, module in enumerate(self.modules):
            wheels, w = module.wheels, v[3 * j + 2]
            for k in range(4):
                rho, eta, phi = self.wheel(j, k)
                along, across = self.contact(module, wheels.radius * v[phi] - v[rho], v[eta])
                found[rho] = along + wheels.mass * v[eta] * w  # Eq. 10
                found[eta] = across - wheels.mass * v[rho] * w  # Eq. 11
                sign = tanh(v[phi] / self.parameters.friction.rest_speed)
                rolling = module.contact.rolling * self.load * sign
                found[phi] = torques[4 * j + k] - wheels.radius * along - rolling  # Eq. 12
        return found

    def solved(self, q: Array, v: Array, torques: Array) -> tuple[Array, Array]:
        """Return q'' and the multipliers R of M q'' + A^T R = B tau - C - f, A q'' = -A' q'."""
        a, rates = self.constraints(q, v)
        count, size = a.shape
        whole = np.zeros((size + count, size + count))
        whole[:size, :size] = np.diag(self.mass())
        whole[:size, size:] = a.T
        whole[size:, :size] = a
        right = np.concatenate([self.forces(v, torques) + self.stops(q, v), -rates])
        found = np.linalg.solve(whole, right)
        return found[:size], found[size:]

    def consistent(
        self, headings: Array, first: Array, rates: Array, spins: Array
    ) -> tuple[Array, Array]:
        """Return q and q' that keep the constraints.

        ``first`` is the velocity of the first module's centre, which is at the origin; ``spins``
        the speed of each wheel, shape (4 n,).
        """
        n = len(self.modules)
        q, v = np.zeros(15 * n), np.zeros(15 * n)
        q[2 : 3 * n : 3], v[2 : 3 * n : 3] = headings, rates
        v[:2] = first
        for j in range(1, n):
            ahead, module = self.modules[j - 1], self.modules[j]
            for th, length in ((j - 1, ahead.hinge_behind), (j, module.hinge_ahead)):
                q[3 * j : 3 * j + 2] -= length * np.array([cos(headings[th]), sin(headings[th])])
                turned = np.array([-sin(headings[th]), cos(headings[th])])
                v[3 * j : 3 * j + 2] -= length * rates[th] * turned
            q[3 * j : 3 * j + 2] += q[3 * j - 3 : 3 * j - 1]
            v[3 * j : 3 * j + 2] += v[3 * j - 3 : 3 * j - 1]
        v[11 * n :] = spins
        a, _ = self.constraints(q, v)
        v[3 * n : 11 * n] = 0.0
        paper = a[: 8 * n]
        for row in range(8 * n):
            at = int(np.flatnonzero(paper[row, 3 * n : 11 * n])[0]) + 3 * n
            v[at] = -paper[row] @ v
        return q, v

    def start(self, targets: Array) -> tuple[Callable[[float, Array], Array], Array]:
        """Return dy/dt and y at rest: q (30,), v (30,) and what the two drives integrate (2,).

        The motors of two modules go to ``targets`` (2,) in rad/s; no torque is limited.
        """
        drive = self.parameters.drive

        def rate(_: float, y: Array) -> Array:
            q, v, error_sum = y[:30], y[30:60], y[60:]
            error = targets - drive.gear_ratio * v[22:24]
            torques = drive.proportional * error + drive.integral * error_sum
            pair = drive.gear_ratio * torques / 2
            found = self.solved(q, v, np.concatenate([pair, pair, np.zeros(4)]))[0]
            return np.concatenate([v, found, error])

        rest = self.consistent(np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(8))
        return rate, np.concatenate([*rest, np.zeros(2)])
