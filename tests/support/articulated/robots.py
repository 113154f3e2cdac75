"""Articulated robots for tests: the shipped one, altered ones, and how they are driven."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigd_sim.articulated import kernel, records
from rigd_sim.articulated.parameters import ArticulatedParameters
from rigd_sim.articulated.plant import ArticulatedConfig

Array = NDArray[np.float64]
STEP_S = 5e-4


@cache
def shipped() -> ArticulatedParameters:
    parameters: ArticulatedParameters = ArticulatedConfig().read_parameters()
    return parameters


def altered(changes: Mapping[str, Any], parameters: Any = None) -> Any:
    """Return ``parameters`` with values replaced by their path: ``{"friction.static": 1.0}``.

    ``modules.*`` stands for every module.
    """
    found = shipped() if parameters is None else parameters
    for path, value in changes.items():
        found = _with(found, path.split("."), value)
    return found


def _with(node: Any, path: list[str], value: Any) -> Any:
    key, rest = path[0], path[1:]
    if isinstance(node, dict):
        keys = list(node) if key == "*" else [key]
        return {**node, **{name: _with(node[name], rest, value) for name in keys}}
    inner = _with(getattr(node, key), rest, value) if rest else value
    return node.model_copy(update={key: inner})


def chain(count: int, **changes: Any) -> ArticulatedParameters:
    """Return a robot of ``count`` modules that differ, the first of which drives."""
    front, rear = shipped().modules.values()
    modules = {"m0": altered({"hinge_behind": 0.2}, front)}
    for place in range(1, count):
        sizes = {
            "body_mass": 3.0 + 0.4 * place, "body_inertia": 0.03 + 0.004 * place,
            "hinge_ahead": 0.2 + 0.01 * place, "hinge_behind": 0.18 + 0.02 * place,
        }  # fmt: skip
        modules[f"m{place}"] = altered(sizes, rear)
    found: ArticulatedParameters = altered(changes, altered({"modules": modules}))
    return found


def unlike() -> ArticulatedParameters:
    """Return a robot of three modules that have nothing in common; all but the middle one drive."""
    first, middle, last = chain(3, **{"modules.*.wheels.pairing": "single"}).modules.values()
    modules = {
        "first": altered({"wheels.driven": "front", "contact.static": 1.1}, first),
        "middle": altered(
            {
                "contact.longitudinal": 90.0, "contact.lateral": 150.0, "contact.rolling": 1.2e-3,
                "contact.static": 0.7, "contact.kinetic": 0.5, "wheels.radius": 0.05,
                "hinge": altered({"stop": 0.5, "damping": 0.2}, shipped().hinge),
            },
            middle,
        ),
        "last": altered(
            {
                "wheels.driven": "rear", "contact.kinetic": 0.45, "half_track": 0.12,
                "drive": altered({"gear_ratio": 30.0, "proportional": 4e-4}, shipped().drive),
            },
            last,
        ),
    }  # fmt: skip
    found: ArticulatedParameters = altered({"modules": modules})
    return found


@dataclass
class Driven:
    """A robot that is integrated by the kernel without a plant."""

    parameters: ArticulatedParameters = field(default_factory=shipped)
    law: str = "paper"
    loads: str = "equal"
    step_s: float = STEP_S
    poses: int = 0

    def __post_init__(self) -> None:
        self.robot = records.robot(self.parameters, law=self.law, loads=self.loads, noise=False)
        self.n, self.m = len(self.robot.modules), len(self.robot.spins)
        self.state = self.robot.at_rest()
        self.slides, self.scratch = self.robot.slides(), self.robot.scratch()
        self.commands = self.robot.commands()
        self.driven = np.flatnonzero(self.robot.spins["driven"])
        self.track = np.zeros((self.poses, 3 * self.n))
        self.steps = 0
        self.stored_at_start = self.robot.stored(self.state)

    def play(self, seconds: float, *targets: float, ramp_s: float = 0.0) -> Driven:
        """Hold motor speeds in rad/s, reached from the present ones by ramps."""
        before = self.commands[self.driven, 0].copy()
        self.commands[self.driven, 1] = 1.0
        rising = round(ramp_s / self.step_s)
        for step in range(rising):
            share = (step + 0.5) / rising
            self.commands[self.driven, 0] = before + share * (np.array(targets) - before)
            self._advance(1)
        self.commands[self.driven, 0] = targets
        self._advance(round(seconds / self.step_s) - rising)
        return self

    def _advance(self, steps: int) -> None:
        kernel.integrate(
            self.robot, self.commands, self.state, self.slides, self.scratch, self.track,
            self.steps, self.step_s, steps, True,
        )  # fmt: skip
        self.steps += steps

    @property
    def centres(self) -> Array:
        """Centres of the modules in m, shape (n, 2)."""
        return self.robot.centres(self.state)

    @property
    def headings(self) -> Array:
        """Headings of the modules in rad, shape (n,)."""
        return self.state[2 : 2 + self.n]

    @property
    def yaw_rates(self) -> Array:
        """Yaw rates of the modules in rad/s, shape (n,)."""
        return self.state[self.n + 4 : 2 * self.n + 4]

    @property
    def residual(self) -> float:
        """Energy in J that was made from nothing since the start."""
        first = self.robot.first_spin + 3 * self.m
        supplied, lost = self.state[first : first + 2]
        return float(self.robot.stored(self.state) - self.stored_at_start - supplied + lost)

    def truth(self, module: int) -> Array:
        """Return the hidden state of a module in the order of layout.TRUTH."""
        from rigd_sim.articulated import layout

        shown = np.zeros(len(layout.TRUTH))
        arrays = (self.commands, self.state, self.slides, self.scratch)
        kernel.show(self.robot, *arrays, module, shown)
        return shown

    def torques(self) -> Array:
        """Return the torques of the driven motors in N m."""
        readings = np.zeros((self.m, 2))
        kernel.advance(
            self.robot, self.commands, self.state, self.slides, self.scratch, self.track,
            self.steps, self.step_s, 0, True, readings, 0, 0,
        )  # fmt: skip
        return np.asarray(readings[self.driven, 1])

    def rates(self) -> Array:
        """Return the rates of the state."""
        rates, excess, torques = (
            np.zeros(len(self.state)),
            np.zeros(4 * self.n),
            np.zeros(2 * self.m),
        )
        work = np.zeros((self.n, records.WORK + self.n))
        kernel.refer(work, self.state, self.n, True)
        robot = self.robot
        parts = (robot.constants[0], *robot[1:], self.commands, self.state, rates)
        kernel.evaluate(*parts, self.slides, excess, torques, work, None)
        kernel.sort_branches(self.slides, excess, 0.0)
        kernel.evaluate(*parts, self.slides, excess, torques, work, None)
        return rates


def radius(track: Array, module: int) -> float:
    """Return the radius in m of the circle that fits the poses of a module best."""
    x, y = track[:, 3 * module], track[:, 3 * module + 1]
    matrix = np.column_stack([2 * x, 2 * y, np.ones(len(x))])
    a, b, c = np.linalg.lstsq(matrix, x**2 + y**2, rcond=None)[0]
    return float(np.sqrt(c + a * a + b * b))
