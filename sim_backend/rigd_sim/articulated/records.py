"""Defines the memory of the compiled kernel: constants of robot, modules and spins, and the state.

All fields are float64 without padding, so that a C struct of doubles has the same layout. The
field names are part of the kernel's compiled signature. If a name changes, numba compiles the
kernel again.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigd_sim.articulated import layout
from rigd_sim.articulated.parameters import ArticulatedParameters, Module

Floats = NDArray[np.float64]


def _doubles(names: str) -> np.dtype[np.void]:
    return np.dtype([(name, np.float64) for name in names.split()])


ROBOT: Final = _doubles("mass law loads gravity width rest speed_noise torque_noise")
MODULES: Final = _doubles(
    # with wheels; of a body frame forward and left; `lag` is the rate of load transfer; `stop` is
    # of the hinge ahead
    "mass inertia b d r k_lon k_lat k_roll mu_s mu_d load height lever stiffness damping "
    "roll_inertia pitch_inertia lag stop stop_stiffness stop_damping"
)
#: What turns by itself: a geared pair, or a single wheel. ``inertia`` is at the wheel.
SPINS: Final = _doubles("inertia ratio driven module kp ki torque_limit")

#: Scratch of a module in the kernel: cosine and sine of its heading, then world force and moment,
#: then heading, cosine and sine that the next ones are computed from; then a row of the equations.
WORK: Final = 8
#: State of a module on its suspension: heave, roll, pitch and their rates. With load transfer the
#: first two are the lagged forces along and across.
LEGS: Final = 6


class Robot(NamedTuple):
    """The robot as the kernel takes it.

    ``beta`` and ``gram`` have shape (n, n): the centres are r_C + sum_j beta_ij e(th_j), and
    gram = beta^T diag(M) beta (articulated.md 7). ``wheel_spin`` has shape (n, 4): the number of
    the spin that turns a wheel.
    """

    constants: NDArray[np.void]
    modules: NDArray[np.void]
    spins: NDArray[np.void]
    beta: Floats
    gram: Floats
    wheel_spin: NDArray[np.int64]

    @property
    def first_spin(self) -> int:
        """Index of the first spin's speed in the state."""
        return 2 * (len(self.modules) + 2)

    @property
    def size(self) -> int:
        """Length of the state.

        In order: centre of mass and headings; their rates; for each spin its speed, the integral
        of its drive, its angle; energy supplied and dissipated; :data:`LEGS` for each module.
        """
        return self.first_spin + 3 * len(self.spins) + 2 + LEGS * len(self.modules)

    def at_rest(self) -> Floats:
        """Return a state at rest: the modules in a line along x, the first one's centre at 0."""
        state = np.zeros(self.size)
        state[0] = -self.beta[0].sum()
        return state

    def placed(self, x: float, y: float, headings: Floats) -> Floats:
        """Return a state at rest with the first module's centre at (x, y), shape (size,)."""
        state = self.at_rest()
        state[2 : 2 + len(headings)] = headings
        state[0] = x - self.beta[0] @ np.cos(headings)
        state[1] = y - self.beta[0] @ np.sin(headings)
        return state

    def commands(self) -> Floats:
        """Return commands for every spin, shape (m, 2): motor speed in rad/s, whether enabled."""
        return np.zeros((len(self.spins), 2))

    def slides(self) -> NDArray[np.bool_]:
        """Return the contacts of all wheels as gripping, shape (4 n,)."""
        return np.zeros(4 * len(self.modules), np.bool_)

    def scratch(self) -> Floats:
        """Return memory for the kernel's intermediate values."""
        n, m = len(self.modules), len(self.spins)
        return np.zeros(7 * self.size + n * (WORK + n) + 2 * m + 4 * n)

    def centres(self, state: Floats) -> Floats:
        """Return the centres of all modules in m, shape (n, 2)."""
        heading = state[2 : 2 + len(self.modules)]
        ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        return np.asarray(state[:2] + self.beta @ ahead)

    def speeds(self, state: Floats) -> Floats:
        """Return the velocities of all centres in m/s, shape (n, 2)."""
        n = len(self.modules)
        heading, rate = state[2 : 2 + n], state[n + 4 : 2 * n + 4]
        turning = np.stack([-rate * np.sin(heading), rate * np.cos(heading)], axis=1)
        return np.asarray(state[n + 2 : n + 4] + self.beta @ turning)

    def stored(self, state: Floats) -> float:
        """Return the energy in J in motion, hinge stops and suspension."""
        n, m = len(self.modules), len(self.spins)
        heading, rate, c = state[2 : 2 + n], state[n + 4 : 2 * n + 4], self.constants[0]
        turning = np.diag(self.modules["inertia"])
        turning = turning + self.gram * np.cos(heading[:, None] - heading)
        spin = state[self.first_spin : self.first_spin + m]
        stops = self.modules[1:]
        beyond = np.maximum(0.0, np.abs(np.diff(heading)) - stops["stop"])
        twice = c["mass"] * np.sum(state[n + 2 : n + 4] ** 2) + rate @ turning @ rate
        twice += self.spins["inertia"] @ spin**2 + np.sum(stops["stop_stiffness"] * beyond**2)
        if c["loads"] == layout.LOADS.index("vertical"):
            twice += self._standing(state[-LEGS * n :].reshape(n, LEGS))
        return float(0.5 * twice)

    def _standing(self, legs: Floats) -> float:
        """Return twice the energy in J of the modules on their legs; ``legs`` has shape (n, 6)."""
        module = self.modules
        side = np.outer(module["b"], [-1.0, 1.0, -1.0, 1.0])
        x = np.outer(module["d"], [1.0, 1.0, -1.0, -1.0])
        rise = legs[:, :1] + side * legs[:, 1:2] - x * legs[:, 2:3]
        pressed = np.maximum(0.0, (module["load"] / module["stiffness"])[:, None] - rise)
        inertia = np.stack([module[key] for key in ("mass", "roll_inertia", "pitch_inertia")], 1)
        springs = module["stiffness"] @ np.sum(pressed**2, axis=1)
        weight = 8.0 * module["load"] @ legs[:, 0]
        return float(np.sum(inertia * legs[:, 3:] ** 2) + springs + weight)


def robot(
    parameters: ArticulatedParameters,
    *,
    law: str,
    loads: str,
    noise: bool,
) -> Robot:
    """Return the robot of ``parameters`` with one of layout.LAWS and one of layout.LOADS."""
    modules = list(parameters.modules.values())
    spins: list[tuple[float, ...]] = []
    numbers: list[list[int]] = []
    for place, module in enumerate(modules):
        numbers.append(_spins(parameters, place, module, spins))
    beta = _beta(modules)
    masses = np.array([module.mass for module in modules])
    return Robot(
        constants=_row(ROBOT, _constants(parameters, law, loads, noise)),
        modules=np.concatenate(
            [_row(MODULES, _module(parameters, module, loads)) for module in modules]
        ),
        spins=np.array(spins, SPINS),
        beta=beta,
        gram=beta.T @ (masses[:, None] * beta),
        wheel_spin=np.array(numbers, np.int64),
    )


def _row(dtype: np.dtype[np.void], values: dict[str, float]) -> NDArray[np.void]:
    row = np.zeros(1, dtype)
    for name in dtype.fields or ():
        row[name] = values.pop(name)
    if values:
        raise KeyError(f"constants without a field: {sorted(values)}")
    return row


def _constants(
    parameters: ArticulatedParameters, law: str, loads: str, noise: bool
) -> dict[str, float]:
    friction = parameters.friction
    return {
        "mass": parameters.mass,
        "law": float(layout.LAWS.index(law)),
        "loads": float(layout.LOADS.index(loads)),
        "gravity": parameters.gravity,
        "width": friction.width,
        "rest": friction.rest_speed,
        "speed_noise": parameters.motor_sensors.speed_noise * noise,
        "torque_noise": parameters.motor_sensors.torque_noise * noise,
    }


def _module(parameters: ArticulatedParameters, module: Module, loads: str) -> dict[str, float]:
    legs, contact, hinge = module.suspension, module.contact, parameters.hinge_ahead(module)
    static, kinetic = parameters.coefficients(module)
    return {
        "mass": module.mass,
        "inertia": module.inertia,
        "b": module.half_track,
        "d": module.half_wheelbase,
        "r": module.wheels.radius,
        "k_lon": contact.longitudinal,
        "k_lat": contact.lateral,
        "k_roll": contact.rolling,
        "mu_s": static,
        "mu_d": kinetic,
        "load": parameters.static_load(module, equal=loads == "equal"),
        "height": legs.height,
        "lever": legs.height - module.wheels.radius,
        "stiffness": legs.stiffness,
        "damping": legs.damping,
        "roll_inertia": legs.roll_inertia,
        "pitch_inertia": legs.pitch_inertia,
        "lag": float(np.sqrt(4 * legs.stiffness / module.mass)),
        "stop": hinge.stop,
        "stop_stiffness": hinge.stiffness,
        "stop_damping": hinge.damping,
    }


def _spins(
    parameters: ArticulatedParameters,
    place: int,
    module: Module,
    spins: list[tuple[float, ...]],
) -> list[int]:
    """Append the spins of a module, and return the number of the spin of each of its wheels."""
    wheels, drive = module.wheels, parameters.drive_of(module)
    control = drive.proportional, drive.integral, drive.torque_limit
    first, pairs = len(spins), 2 if wheels.pairing == "geared" else 1
    for front in layout.AT_FRONT if pairs == 1 else layout.AT_FRONT[:2]:
        driven = wheels.driven in ("all", "front" if front else "rear")
        rotor = drive.gear_ratio**2 * drive.rotor_inertia if driven else 0.0
        inertia = pairs * wheels.spin_inertia + rotor
        spins.append((inertia, drive.gear_ratio, float(driven), float(place), *control))
    return [first + (wheel % 2 if pairs == 2 else wheel) for wheel in range(4)]


def _beta(modules: list[Module]) -> Floats:
    """Return beta, shape (n, n): the centres about the centre of mass (Eqs. 4, 5, any length)."""
    count = len(modules)
    offsets = np.zeros((count, count))
    for j in range(1, count):
        offsets[j] = offsets[j - 1]
        offsets[j, j - 1] -= modules[j - 1].hinge_behind
        offsets[j, j] -= modules[j].hinge_ahead
    masses = np.array([module.mass for module in modules])
    return np.asarray(offsets - masses @ offsets / masses.sum())
