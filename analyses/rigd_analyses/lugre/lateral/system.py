"""Adds the lateral coupling to the simulated rig: the rollers push on guide and bearings.

The lateral speed is measured, like the current. During a drive it is nearly constant, and so is the
load that follows from it. A trial is therefore simulated like one without lateral motion, but with
its own guide friction and bearing torque (lugre.md section 2, items 6 and 11). If the friction of
the guide differs from its mean, carriage and wheel accelerate together, with the inertia
m_T + I / r^2. The contact force changes by a twelfth of the difference; the slip does not show it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from rigd.analysis.fitting.model import FitParameter, Scaling
from rigd.analysis.output_error.innovations import Deviations
from rigd.analysis.output_error.system import Output, Unknown
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.lateral.constants import LateralConstants
from rigd_analyses.lugre.lateral.coupling import NAMES, LiftedRows, Load, Shape, load
from rigd_analyses.lugre.lateral.thresholds import LATERAL
from rigd_analyses.lugre.rig.outputs import ACCELERATION, TRAVEL
from rigd_analyses.lugre.rig.system import GUIDE, LEAD, NO_LOAD, RigSystem
from rigd_analyses.lugre.trials.known_constants import Known

REACH = 8.0  #: a length may move by this many of its uncertainties
FAR = 4.0  #: and one that must be positive by this factor
LEAST_U = 1e-4  #: relative: no length is known better than this
#: Of the load; Sensors 2025 25(16) 5026 has 0.009 to 0.048 at one speed.
DRY_BOX = (1e-3, 0.3)
VISCOUS_BOX = (1e-4, 1.0)  #: s/m
FIRST_DRY, FIRST_VISCOUS = 0.02, 0.02  #: start of a fit


@dataclass(frozen=True, eq=False)
class LateralSystem:
    """The trials with their lateral speeds; a :class:`rigd.analysis.output_error.system.System`.

    Its shared unknowns are those of ``rig`` and then those of the coupling. ``speeds`` are lateral
    speeds of each trial while it is driven, at equal distances of time, (n,); ``turned`` takes them
    with the other sign. ``bearing_torque`` is that of the wheel's bearings without lateral motion,
    in N m. ``friction`` replaces the friction along the guide (6) of ``rig``, if there is any.
    """

    rig: RigSystem
    speeds: tuple[FloatArray, ...]
    lateral: LateralConstants
    bearing_torque: float
    rows: LiftedRows = LiftedRows.PRINTED
    turned: bool = False
    friction: tuple[Unknown, ...] = ()
    shared: tuple[Unknown, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "shared", (*self.straight, *_unknowns(self.lateral)))

    @property
    def straight(self) -> tuple[Unknown, ...]:
        """Return the shared unknowns without those of the coupling."""
        return (*self.friction, *self.rig.shared[len(self.friction) :])

    @property
    def local(self) -> tuple[Unknown, ...]:
        """Return the unknowns of each trial."""
        return self.rig.local

    @property
    def outputs(self) -> tuple[Output, ...]:
        """Return slip, travel and acceleration."""
        return self.rig.outputs

    @property
    def measured(self) -> tuple[FloatArray, ...]:
        """Return the measured outputs of each trial, (n, 3)."""
        return self.rig.measured

    def coupling(self, shared: FloatArray) -> FloatArray:
        """Return the parameters of the coupling (7,), as :mod:`.coupling` names them."""
        return shared[len(self.rig.shared) :]

    def simulate(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the outputs (n, 3) of one trial."""
        found = self._load(trial, shared)
        outputs = self.rig.simulate(trial, self._under(found, shared), local)
        return outputs + self._drift(trial, shared[GUIDE] * found.guide[:, None])[:, :, 0]

    def ignoring(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the outputs (n, 3) of one trial without any lateral force (G = 0)."""
        return self.rig.simulate(trial, shared[: len(self.rig.shared)], local)

    def linearise(
        self, trial: int, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the outputs (n, 3) and their derivatives to all parameters (n, 3, p + l)."""
        found = self._load(trial, shared)
        friction, count = shared[GUIDE], len(self.rig.shared)
        outputs, straight = self.rig.linearise(trial, self._under(found, shared), local)
        by_load = friction * np.mean(found.guide_by, axis=0)
        by_bearing = self.bearing_torque * np.mean(found.bearing_by, axis=0)
        by_coupling = (
            straight[:, :, GUIDE, None] * by_load + straight[:, :, NO_LOAD, None] * by_bearing
        )
        out = np.concatenate([straight[:, :, :count], by_coupling, straight[:, :, count:]], axis=2)
        drift = self._drift(
            trial, np.column_stack([found.guide, friction * found.guide_by, friction * found.guide])
        )
        out[:, :, GUIDE] = out[:, :, GUIDE] * np.mean(found.guide) + drift[:, :, 0]
        out[:, :, count : count + len(NAMES)] += drift[:, :, 1:-1]
        return outputs + drift[:, :, -1], out

    def deviations(self, trial: int, shared: FloatArray, local: FloatArray) -> Deviations:
        """Return how noise of current and sensors moves the outputs of one trial."""
        # The belts move before the step: what may settle hides there what differs by recording.
        return self.rig.deviations(trial, self.effective(trial, shared), local, settles=False)

    def guide_friction(self, shared: FloatArray, speed_m_s: FloatArray) -> FloatArray:
        """Return the friction of the guide in N at lateral speeds (n,)."""
        speed = -speed_m_s if self.turned else speed_m_s
        found = load(speed, self.coupling(shared), self.shape)
        return np.asarray(shared[GUIDE] * found.guide)

    def effective(self, trial: int, shared: FloatArray) -> FloatArray:
        """Return the parameters of the straight rig under the mean load of one trial."""
        return self._under(self._load(trial, shared), shared)

    def mean_force(self, trial: int, shared: FloatArray) -> float:
        """Return the mean friction of the guide in N during one trial, at a load of 1."""
        return float(shared[GUIDE] * np.mean(self._load(trial, shared).guide))

    def besides(self, trial: int, shared: FloatArray) -> tuple[FloatArray, float]:
        """Return what the coupling adds to the mean force in one trial.

        That is the outputs (n, 3) of what varies, and in N m the torque of the bearings.
        """
        found = self._load(trial, shared)
        drift = self._drift(trial, shared[GUIDE] * found.guide[:, None])[:, :, 0]
        return drift, self.bearing_torque * (float(np.mean(found.bearing)) - 1.0)

    def direction(self, trial: int) -> float:
        """Return the sign of the motion of one trial: -1 if the motor drives it backwards."""
        return math.copysign(1.0, self.rig.trials[trial].trial.current_a)

    def _under(self, found: Load, shared: FloatArray) -> FloatArray:
        """Return the parameters of the straight rig under a mean load."""
        effective = shared[: len(self.rig.shared)].copy()
        effective[GUIDE] *= np.mean(found.guide)
        effective[NO_LOAD] += self.bearing_torque * (np.mean(found.bearing) - 1.0)
        return effective

    def _load(self, trial: int, shared: FloatArray) -> Load:
        """Return the load of one trial at its lateral speeds."""
        speed = self.speeds[trial]
        if abs(float(np.mean(speed))) < LATERAL.min_speed_m_s:
            ones, blank = np.ones(len(speed)), np.zeros((len(speed), len(NAMES)))
            return Load(ones, ones, blank, blank)
        return load(-speed if self.turned else speed, self.coupling(shared), self.shape)

    def _drift(self, trial: int, forces_n: FloatArray) -> FloatArray:
        """Return the outputs (n, 3, k) that forces along the guide (speeds, k) add to their mean's.

        They act against the motion, on carriage and wheel as on one body.
        """
        rig, period = self.rig.constants, self.rig.period_s
        count = len(self.rig.measured[trial])
        moved = rig.mass.value + rig.inertia.value / rig.wheel_radius.value**2
        of_sample = np.linspace(0, len(forces_n), count - LEAD, endpoint=False).astype(np.intp)
        against = -self.direction(trial) / moved
        acceleration = against * (forces_n - np.mean(forces_n, axis=0))[of_sample]
        speed = np.cumsum(acceleration, axis=0) * period
        out = np.zeros((count, len(self.outputs), forces_n.shape[1]))
        out[LEAD:, TRAVEL] = np.cumsum(speed, axis=0) * period
        out[LEAD:, ACCELERATION] = acceleration
        return out

    @property
    def shape(self) -> Shape:
        """Return what the coupling depends on and the data do not determine."""
        lateral = self.lateral
        return Shape(
            math.copysign(1.0, lateral.lever.value), self.rig.constants.wheel_radius.value,
            lateral.bearing_spacing, lateral.bearing_overhang, self.rows,
        )  # fmt: skip


def _unknowns(lateral: LateralConstants) -> tuple[Unknown, ...]:
    """Return the unknowns of the coupling, in the order of :data:`.coupling.NAMES`."""
    lever = Known(abs(lateral.lever.value), lateral.lever.u)
    k = lateral.mass_offset
    u = max(k.u, LEAST_U * abs(k.value))
    reach = REACH * u
    return (
        _roller("mu_R_dry", "1", lateral.dry, DRY_BOX, FIRST_DRY, "dry friction of the rollers"),
        _roller(
            "mu_R_vis", "s/m", lateral.viscous, VISCOUS_BOX, FIRST_VISCOUS,
            "viscous friction of the rollers",
        ),
        _length("guide_lever", lever, "lever d - e of the guide"),
        _length("guide_height", lateral.height, "height of the guide over the floor"),
        _length("guide_half_span", lateral.half_span, "half distance of the guide's reactions"),
        _length("row_distance", lateral.row_distance, "distance of the rows of rollers"),
        Unknown(
            FitParameter(
                "mass_offset", "m", k.value - reach, k.value + reach, k.value, Scaling.LINEAR
            ),
            u, "offset of the mass from the first row",
        ),
    )  # fmt: skip


def _length(name: str, known: Known, wording: str) -> Unknown:
    parameter = FitParameter(name, "m", known.value / FAR, known.value * FAR, known.value)
    return Unknown(parameter, max(known.u / known.value, LEAST_U), wording)


def _roller(
    name: str, unit: str, known: Known | None, box: tuple[float, float], first: float, wording: str
) -> Unknown:
    if known is None:
        return Unknown(FitParameter(name, unit, *box, first))
    low, high = min(box[0], known.value / FAR), max(box[1], known.value * FAR)
    relative = max(known.u / known.value, LEAST_U)
    return Unknown(FitParameter(name, unit, low, high, known.value), relative, wording)
