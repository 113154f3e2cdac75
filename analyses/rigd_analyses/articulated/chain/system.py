"""The chain's trials as a system of the output-error estimator: motor speeds in; all else out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import interp1d

from rigd.analysis.fitting.model import FitParameter, Scaling
from rigd.analysis.output_error.innovations import Deviations
from rigd.analysis.output_error.system import Output, Unknown
from rigd.analysis.result import FloatArray
from rigd_analyses.articulated.chain.geometry import (
    BODY,
    RAW,
    WHEEL,
    derived,
    fastest,
    motion,
    placed,
)
from rigd_analyses.articulated.chain.kernel import (
    ADDED,
    FORCES,
    HALF_BASE,
    HALF_TRACK,
    K_LAT,
    K_LON,
    RADIUS,
    ROLLING,
    W0,
    simulate,
)
from rigd_analyses.articulated.chain.layout import SIZES, Layout
from rigd_analyses.articulated.chain.needs import HINGES, OF_MODULE, OF_ROBOT
from rigd_analyses.articulated.reading import TORQUE_FRAMES, RobotTrial
from rigd_analyses.articulated.robot import CAMERA, RecordedRobot, finer, means
from rigd_analyses.articulated.system import FAR, FREE, LEAST_U, STABLE

LOAD: Final = "gravity"
#: Of the logarithm, by which the contacts of two modules differ unless the data know it better:
#: tyres and floors are alike within a factor of e. It keeps the fit where no data lead.
ALIKE_U: Final = 1.0
UNITS: Final = {
    "k_lon": "N s/m", "k_lat": "N s/m", "k_roll": "m",
    **{"scale_x": "1", "scale_y": "1", "latency": "s"},
}  # fmt: skip
NONE: Final = np.zeros((0, 0, FORCES, 0))


def unit_of(name: str) -> str:
    """Return the unit of a contact parameter, a constant or a value of the camera."""
    if name.startswith("module_"):
        name = name[9:]
    known = UNITS | OF_MODULE | HINGES | OF_ROBOT
    return known[name]


def contact_name(kind: str, module: int) -> str:
    """Return the name of a contact parameter of one module (from 0)."""
    return f"{kind}_{module + 1}"


@dataclass(frozen=True, eq=False)
class Run:
    """The simulation of a trial at its f frames, in lanes if it has derivatives.

    ``pose`` (f, 3 n) as the camera shows it in the frame of the start, ``rate`` (f, 3 n) and
    ``by_pose`` (f, 3 n, lanes) of it; ``states`` (f, 3 n + 4) and ``by_states`` without latency;
    ``values`` (n, VALUES) of the modules with ``by_values`` (n, VALUES, lanes).
    """

    pose: FloatArray
    rate: FloatArray
    by_pose: FloatArray
    states: FloatArray
    by_states: FloatArray
    values: FloatArray
    by_values: FloatArray


@dataclass(frozen=True, eq=False)
class ChainSystem(RecordedRobot):
    """The trials; a :class:`rigd.analysis.output_error.system.System`.

    ``gears`` (motors,) are the ratios. Contacts that are ``known``, by :func:`contact_name`, have a
    value and a relative standard uncertainty, as constants do.
    """

    layout: Layout
    gears: FloatArray
    known: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @cached_property
    def contacts(self) -> tuple[Unknown, ...]:
        """Return the contact parameters.

        The first of each kind is free; each further one stands over it, as a ratio. Those of a
        model that is tried stand by themselves.
        """
        found = []
        for kind, module in self.layout.contacts:
            name = contact_name(kind, module)
            low, high, start = FREE[kind]
            if self.known:
                start, u = self.known.get(name, (start, math.inf))
                found.append(Unknown(FitParameter(name, UNITS[kind], low, high, start), u))
            elif module == self.layout.of_kind(kind)[0]:
                found.append(Unknown(FitParameter(name, UNITS[kind], low, high, start)))
            else:
                first = contact_name(kind, self.layout.of_kind(kind)[0])
                ratio = FitParameter(f"{name} / {first}", "1", 0.02, 50.0, 1.0)
                found.append(Unknown(ratio, ALIKE_U, f"likeness of {name} and {first}"))
        return tuple(found)

    @cached_property
    def sizes(self) -> tuple[str, ...]:
        """Return the names of the constants that the simulation takes."""
        every = [key for keys in self.layout.keys for key in keys if key]
        return (*dict.fromkeys(every), LOAD)

    @cached_property
    def shared(self) -> tuple[Unknown, ...]:
        """Return contacts, constants and camera."""
        found = list(self.contacts)
        for name in self.sizes:
            value, u = self.constants[name]
            parameter = FitParameter(name, unit_of(name), value / FAR, value * FAR, value)
            found.append(Unknown(parameter, max(u / value, LEAST_U), name.replace("_", " ")))
        for name in CAMERA:
            low, high, start = FREE[name]
            parameter = FitParameter(name, UNITS[name], low, high, start, Scaling.LINEAR)
            found.append(Unknown(parameter))
        return tuple(found)

    @cached_property
    def local(self) -> tuple[Unknown, ...]:
        """Return by how much each trial begins off where its first frames show the robot."""
        return self.begin([f"hinge_{k}" for k in range(1, self.layout.modules)])

    @property
    def ratios(self) -> FloatArray:
        """Return the gear ratio of each motor, (motors,)."""
        return self.gears

    @property
    def outputs(self) -> tuple[Output, ...]:
        """Return torques and poses."""
        signals = self.layout.signals
        units = ["N m"] * len(signals.torques) + ["m", "m", "rad"] * self.layout.modules
        names = (*signals.torques, *signals.poses)
        return tuple(
            Output(name.replace("_", " "), unit) for name, unit in zip(names, units, strict=True)
        )

    def simulate(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the outputs of one trial, (n, motors + 3 modules)."""
        run = self.run(trial, shared, local, np.zeros((self._raw_count, 0)))
        return self._outputs(trial, run, shared, local)

    def linearise(
        self, trial: int, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the outputs of one trial and their derivatives to all parameters."""
        inside, first, hinges = len(self.contacts) + len(self.sizes), len(shared), len(local) - 4
        run = self.run(trial, shared, local, self._directions(shared))
        outputs = self._outputs(trial, run, shared, local)
        lanes = self.outputs_of(trial, run, shared, local)
        out = np.zeros((*outputs.shape, first + len(local)))
        out[:, :, :inside] = lanes[:, :, :inside]
        out[:, :, first + 3 : first + 3 + hinges] = lanes[:, :, inside:]
        self.linearise_camera(trial, run.pose, run.rate, shared, local, out)
        out[:, : self.motors, -1] = self.gears * self.gained(trial)
        return outputs, out

    @property
    def _raw_count(self) -> int:
        """Return how many raw values there are: RAW of each module, and gravity."""
        return len(RAW) * self.layout.modules + 1

    def raw(self, shared: FloatArray) -> FloatArray:
        """Return the raw values of all modules, then gravity, of shared parameters (p,)."""
        found = dict(zip(self.names, np.asarray(shared).tolist(), strict=False))
        rows = np.ones((self.layout.modules, len(RAW)))
        for (kind, module), item in zip(self.layout.contacts, self.contacts, strict=True):
            value = found[item.parameter.name]
            first = self.layout.of_kind(kind)[0]
            if not self.known and module != first:
                value *= found[contact_name(kind, first)]
            rows[module, RAW.index(kind)] = value
        for module, keys in enumerate(self.layout.keys):
            for name, key in zip(SIZES, keys, strict=True):
                rows[module, RAW.index(name)] = found[key] if key else 0.0
        return np.append(rows.ravel(), found[LOAD])

    def _directions(self, shared: FloatArray) -> FloatArray:
        """Return the derivatives of :meth:`raw` to contacts and constants."""
        raw, width = self.raw(shared), len(RAW)
        contacts = {name: k for k, name in enumerate(self.layout.contacts)}
        out = np.zeros((self._raw_count, len(self.contacts) + len(self.sizes)))
        for (kind, module), lane in contacts.items():
            at = width * module + RAW.index(kind)
            first = self.layout.of_kind(kind)[0]
            if self.known or module == first:
                out[at, lane] = 1.0
            else:
                base = raw[width * first + RAW.index(kind)]
                out[at, lane], out[at, contacts[kind, first]] = base, raw[at] / base
        for module, keys in enumerate(self.layout.keys):
            for name, key in zip(SIZES, keys, strict=True):
                if key:
                    lane = len(self.contacts) + self.sizes.index(key)
                    out[width * module + RAW.index(name), lane] = 1.0
        out[-1, -1] = 1.0
        return out

    def run(
        self, trial: int, shared: FloatArray, local: FloatArray, directions: FloatArray,
        pushes: FloatArray = NONE,
    ) -> Run:  # fmt: skip
        """Return the simulation of one trial.

        Its lanes are the derivatives along ``directions`` (raw values, lanes) of :meth:`raw`, with
        those to the hinges behind; or, if given, for each unit of ``pushes`` (frames, n, FORCES,
        lanes), forces and moments on the modules.
        """
        item, layout = self.trials[trial], self.layout
        values, by = derived(self.raw(shared), directions, layout.modules)
        hinges = layout.modules - 1 if directions.shape[1] else 0
        lanes = pushes.shape[3] if len(pushes) else by.shape[2] + hinges
        by_values, by_headings = np.zeros((*values.shape, lanes)), np.zeros((layout.modules, lanes))
        if not len(pushes):
            by_values[:, :, : by.shape[2]] = by
            for k in range(hinges):
                by_headings[1 + k, by.shape[2] + k] = 1.0
        headings = item.standing[2::3] - item.standing[2]
        headings[1:] += local[3 : 2 + layout.modules]
        grid, at = finer(item.grid, item.at, STABLE / fastest(values))
        spins = np.zeros((len(grid), layout.modules, 2))
        for k, motor in enumerate(layout.motors):
            speed = np.interp(grid, item.grid, item.speeds[:, k]) / self.gears[k]
            spins[:, motor.module, motor.side] += motor.count * speed
        acting = np.zeros((0, layout.modules, FORCES, lanes))
        if len(pushes):
            acting = np.asarray(interp1d(item.t_s, pushes, axis=0)(np.minimum(grid, item.t_s[-1])))
        late = float(shared[self.names.index("latency")])
        pose, rate, by_pose, states, by_states = simulate(
            values, by_values, layout.driven, spins, grid, at, late, headings, by_headings, acting
        )
        return Run(
            *placed(values, by_values, pose, rate, by_pose), states, by_states, values, by_values
        )

    def outputs_of(self, trial: int, run: Run, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the derivatives of the outputs that go along with ``run``, in its lanes."""
        out = self.seen(trial, run.by_pose, shared, local)
        item = self.trials[trial]
        span = TORQUE_FRAMES * item.period_s
        gained, spun, signs = self.gained(trial), *self._turning(trial)
        for k, motor in enumerate(self.layout.motors):
            i, arm = motor.module, 1.0 if motor.side == 0 else -1.0
            v, dv = run.values[i], run.by_values[i]
            over, by_over = self._over(run, motor.module, arm, span)
            slip = v[RADIUS] * spun[:, k] - over
            by_slip = dv[RADIUS] * spun[:, k, None] - by_over
            torque = dv[RADIUS] * v[K_LON] * slip[:, None] + v[RADIUS] * (
                dv[K_LON] * slip[:, None] + v[K_LON] * by_slip
            )
            rolled = dv[ROLLING] * v[RADIUS] + v[ROLLING] * dv[RADIUS]
            inertia = dv[ADDED] * v[RADIUS] ** 2 + 2.0 * v[ADDED] * v[RADIUS] * dv[RADIUS]
            torque += rolled * signs[:, k, None] + inertia * gained[:, k, None]
            out[:, k] = np.where(self._filled(item)[:, None], motor.count * torque, 0.0)
            out[:, k] /= self.gears[k]
        return out

    def loads(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the force of each wheel over its load (n, 4 modules), as no contact slides.

        Wheels are those of articulated.md 2: front right, front left, rear right, rear left.
        """
        run = self.run(trial, shared, local, np.zeros((self._raw_count, 0)))
        return np.hypot(*self.forces(trial, run)) / self.wheel_loads(shared)

    def forces(self, trial: int, run: Run) -> tuple[FloatArray, FloatArray]:
        """Return the forces (n, 4 modules) in N along and across of each wheel at the frames."""
        item, n = self.trials[trial], self.layout.modules
        along, across = np.zeros((len(item.poses), 4 * n)), np.zeros((len(item.poses), 4 * n))
        u, lat, om = motion(run.values, run.states)
        for i in range(n):
            v = run.values[i]
            for wheel in range(4):
                end, arm = (1.0 if wheel < 2 else -1.0), (-1.0 if wheel & 1 else 1.0)
                across[:, 4 * i + wheel] = -v[K_LAT] * (lat[:, i] + end * v[HALF_BASE] * om[:, i])
                over = u[:, i] + arm * v[HALF_TRACK] * om[:, i]
                along[:, 4 * i + wheel] = -v[ROLLING] * np.tanh(over / (v[RADIUS] * W0))
                for k, motor in enumerate(self.layout.motors):
                    front = motor.wheels.partition("_")[0]
                    turns = front not in ("front", "rear") or (front == "front") == (wheel < 2)
                    if motor.module == i and motor.side == wheel & 1 and turns:
                        spin = item.speeds[item.at, k] / self.gears[k]
                        along[:, 4 * i + wheel] = v[K_LON] * (v[RADIUS] * spin - over)
        return along, across

    def share(self, trial: int, shared: FloatArray) -> float:
        """Return the largest force of a contact of one trial over its load."""
        return float(np.max(self.loads(trial, shared, np.zeros(len(self.local)))))

    def wheel_loads(self, shared: FloatArray) -> FloatArray:
        """Return the load of each wheel (4 modules,) in N."""
        raw = self.raw(shared)
        rows = raw[:-1].reshape(-1, len(RAW))
        return np.repeat((rows[:, BODY] + 4.0 * rows[:, WHEEL]) * raw[-1] / 4.0, 4)

    def deviations(self, trial: int, shared: FloatArray, local: FloatArray) -> Deviations:
        """Return how noise of the motor speeds and of the sensors moves the outputs of one trial.

        Several modules that drive share the noise of the wheels' speeds; what one would do alone,
        and the others do not let it, is in its torque.
        """
        item = self.trials[trial]
        values, _ = derived(self.raw(shared), np.zeros((self._raw_count, 0)), self.layout.modules)
        drives = sorted({motor.module for motor in self.layout.motors})
        wheel = item.speed_noise / float(np.median(self.gears)) / math.sqrt(len(drives))
        first = values[drives[0]]
        moved = first[RADIUS] * wheel * item.period_s
        centre = np.stack([item.poses[:, 0::3].mean(axis=1), item.poses[:, 1::3].mean(axis=1)], 1)
        apart = [item.poses[:, k : k + 2] - centre for k in range(0, 3 * self.layout.modules, 3)]
        alone, held = np.zeros(self.motors), 1.0 - 1.0 / len(drives)
        for k, motor in enumerate(self.layout.motors):
            v = values[motor.module]
            slip = v[RADIUS] * item.speed_noise / self.gears[k] / math.sqrt(TORQUE_FRAMES)
            alone[k] = held * (motor.count * v[RADIUS] * v[K_LON] * slip / self.gears[k]) ** 2
        return self.course(
            trial, moved / first[HALF_TRACK], moved, drives[0], np.hstack(apart), alone
        )

    def _outputs(self, trial: int, run: Run, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the outputs of a simulation."""
        item = self.trials[trial]
        period = item.period_s
        seen = self.shown(trial, run.pose, shared, local)
        gained, spun, signs = self.gained(trial), *self._turning(trial)
        torques = np.zeros((len(seen), self.motors))
        for k, motor in enumerate(self.layout.motors):
            v, arm = run.values[motor.module], 1.0 if motor.side == 0 else -1.0
            over, _ = self._over(run, motor.module, arm, TORQUE_FRAMES * period)
            of_wheel = v[RADIUS] * v[K_LON] * (v[RADIUS] * spun[:, k] - over)
            of_wheel += v[RADIUS] * v[ROLLING] * signs[:, k]
            of_wheel += v[ADDED] * v[RADIUS] ** 2 * gained[:, k]
            torques[:, k] = np.where(self._filled(item), motor.count * of_wheel, 0.0)
            torques[:, k] += self.gears[k] ** 2 * local[-1] * gained[:, k]
        return np.column_stack([torques / self.gears, seen])

    @staticmethod
    def _filled(item: RobotTrial) -> NDArray[np.bool_]:
        """Return which frames (n,) have TORQUE_FRAMES before them."""
        return np.asarray(np.arange(len(item.poses)) >= TORQUE_FRAMES, dtype=np.bool_)

    def _over(
        self, run: Run, module: int, arm: float, span_s: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return mean speeds (n,) over the ground of a module's side, with derivatives.

        They are means over TORQUE_FRAMES before each frame; ``arm`` is 1 on the right, -1 on the
        left.
        """
        way, heading = 2 * (self.layout.modules + 2) + module, 2 + module
        v, dv = run.values[module, HALF_TRACK], run.by_values[module, HALF_TRACK]
        gone, by_gone = means(run.states[:, way], span_s), means(run.by_states[:, way], span_s)
        turned_by = means(run.states[:, heading], span_s)
        by_turned = means(run.by_states[:, heading], span_s)
        return gone + arm * v * turned_by, by_gone + arm * (dv * turned_by[:, None] + v * by_turned)

    def _turning(self, trial: int) -> tuple[FloatArray, FloatArray]:
        """Return the mean speeds (n, motors) in rad/s of the wheels, and the mean of their sign."""
        item = self.trials[trial]
        span, wheels = TORQUE_FRAMES * item.period_s, item.speeds / self.gears
        found = []
        for part in (wheels, np.tanh(wheels / W0)):
            areas = 0.5 * (part[1:] + part[:-1]) * np.diff(item.grid)[:, None]
            total = np.vstack([np.zeros((1, part.shape[1])), np.cumsum(areas, axis=0)])
            found.append(means(total[item.at], span))
        return found[0], found[1]
