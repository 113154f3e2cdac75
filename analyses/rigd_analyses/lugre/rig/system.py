"""Defines trials of the omni-wheel rig as a system: predicts its outputs from the motor current."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from rigd.analysis.fitting.model import FitParameter, Scaling
from rigd.analysis.output_error.innovations import Deviations
from rigd.analysis.output_error.system import Output, Unknown
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.model import PARAMETERS
from rigd_analyses.lugre.rig import kernel
from rigd_analyses.lugre.rig.current import simulated_current
from rigd_analyses.lugre.rig.deviations import SensorNoise, deviations
from rigd_analyses.lugre.rig.outputs import (
    DYNAMIC,
    FIRST_BRISTLE,
    NAMES,
    SHAKE_COS,
    SHAKE_SIN,
    SHARED,
    TWICE_COS,
    TWICE_SIN,
    WHEEL_DELAY,
    output_slopes,
    outputs,
)
from rigd_analyses.lugre.trials.known_constants import Known, RigConstants
from rigd_analyses.lugre.trials.resolution import Rounding
from rigd_analyses.lugre.trials.trial import LugreTrial

LATE_SENSORS = (
    "delay of the wheel encoder", "delay of the carriage encoder", "delay of the accelerometer"
)  # fmt: skip
REACH = 40.0  #: a constant may move by this many of its uncertainties
FAR = 4.0  #: and one that must be positive by this factor
LEAST_U = 1e-4  #: relative: no constant is known better than this
TINY = 1e-12
TURNING_WINDOW = 21  #: samples, of the rate of the wheel angle that a delay is undone with
LEAD = 40  #: samples of rest before the current step that are simulated
REST = 300  #: samples of rest that the accelerometer's zero is taken from
#: Uncertainties that no constant of the rig states; the sensors are taken to be ordinary ones.
DELAY_S = 1e-3  #: of a sensor against the current
SLOPE_M_S2 = 0.02  #: of the floor, times gravity: 0.1 degrees
DRAG_N_S_M = 0.05  #: of a cable
CURRENT_ZERO_A = 3e-3
ACCELERATION_GAIN = 0.02
RIPPLE = 1.0  #: (m/s^2)/(m/s), of the rollers' transitions
BRISTLE = 0.03  #: z that the return to the start leaves in the contact
ZERO_M_S2 = 0.05
#: Constants of the rig: the same in all groups of trials. Those of floors, and phases that follow
#: from where the wheel's encoder begins, are not.
OF_THE_RIG = (
    *("drive_gain", "no_load", "wheel_viscous", "wheel_inertia", "guide_friction", "drag"),
    *("wheel_radius", "current_zero", "wheel_delay", "carriage_delay", "acceleration_gain"),
    "acceleration_delay",
)
#: Places among the shared unknowns, which begin with those of the recursion.
GUIDE, NO_LOAD = kernel.NAMES.index("guide_friction"), kernel.NAMES.index("no_load")
MASS = SHARED  #: behind those of recursion and outputs
#: Fitted constants of a single recording and mass, in their order behind those of friction.
FITTED_NAMES = (*kernel.NAMES[len(PARAMETERS) : DYNAMIC], *NAMES, "mass")
#: A mass that is a factor larger moves as if these were smaller by it: the force of friction is in
#: proportion to the mass, so that only what is not divides by it.
BY_MASS = tuple(
    kernel.NAMES.index(name)
    for name in (
        *("drive_gain", "no_load", "wheel_viscous", "wheel_inertia", "guide_friction", "drag"),
    )
)
#: What follows from the angle at which the wheel's encoder begins: each recording has its own.
OF_THE_ENCODER = (
    kernel.NAMES.index("ripple_cos"), kernel.NAMES.index("ripple_sin"),
    SHAKE_COS, SHAKE_SIN, TWICE_COS, TWICE_SIN,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class DrivenTrial:
    """One trial from shortly before the current step until something else holds the carriage.

    All arrays (n,); angle as measured, ``turning_rad_s`` its rate; ``measured`` (n, 3) the outputs.
    ``rest_a`` is what the monitor shows before the step.
    """

    label: str
    current_a: FloatArray
    jumps: FloatArray
    angle_rad: FloatArray
    turning_rad_s: FloatArray
    measured: FloatArray
    trial: LugreTrial
    part: slice
    current_noise_a: float
    rest_a: float


@dataclass(frozen=True, eq=False)
class RigSystem:
    """The trials, with what is known of the rig; a ``System`` of output error.

    Outputs: slip travel r_0 angle - position (r_0 as stated: a constant combination of what is
    measured), carriage position, acceleration. The two positions have counts, the accelerometer
    noise; what else they share is drift from the noise of the current. ``constants`` are those at
    a load of 1; a trial with another mass has its share of it as ``load``.

    The first ``MASS`` + 1 shared unknowns are those of a trial of the first recording at the first
    load. Then come the masses of other loads, and :data:`OF_THE_ENCODER` of other recordings;
    ``places`` has for each trial where its own stand.
    """

    trials: tuple[DrivenTrial, ...]
    constants: RigConstants
    period_s: float
    start: FloatArray  #: friction parameters (6,) to start from
    measured: tuple[FloatArray, ...] = field(init=False, repr=False)
    shared: tuple[Unknown, ...] = field(init=False)
    local: tuple[Unknown, ...] = field(init=False)
    places: tuple[NDArray[np.intp], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "measured", tuple(trial.measured for trial in self.trials))
        first = (*self._friction(), *self._known(), self._mass(self.trials[0].trial.load))
        shared, places = self._of_others(first)
        object.__setattr__(self, "shared", shared)
        object.__setattr__(self, "places", places)
        object.__setattr__(self, "local", self._local())

    def mass_kg(self, trial: int) -> float:
        """Return the mass that moves in one trial."""
        return self.constants.mass.value * self.trials[trial].trial.load

    def normal_force_n(self, trial: int) -> float:
        """Return the weight on the wheel in one trial."""
        return self.constants.normal_force_n * self.trials[trial].trial.load

    def recursion(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the parameters (20,) of the recursion in one trial.

        Guide and bearings rub in proportion to the mass that they carry (Eqs. 20, 21, 48).
        """
        own = shared[self.places[trial]]
        q = np.append(own[:DYNAMIC], local[FIRST_BRISTLE])
        load = self.trials[trial].trial.load
        q[GUIDE] *= load
        q[NO_LOAD] += (load - 1.0) * self.constants.bearing_torque.value
        q[list(BY_MASS)] *= self.mass_kg(trial) / own[MASS]
        return q

    @property
    def outputs(self) -> tuple[Output, ...]:
        """Return slip, travel and acceleration."""
        return (
            Output("slip travel", "m"),
            Output("carriage position", "m"),
            Output("acceleration", "m/s^2"),
        )

    @cached_property
    def noise(self) -> SensorNoise:
        """What the readings themselves show of the noise of the sensors."""
        rests = [
            item.trial.acceleration_m_s2[max(0, item.part.start - REST) : item.part.start + LEAD]
            for item in self.trials
        ]
        return SensorNoise(
            float(np.median([item.current_noise_a for item in self.trials])),
            min(item.trial.angle_rounding.of_reading for item in self.trials),
            min(item.trial.position_rounding.of_reading for item in self.trials),
            max(
                float(np.sqrt(np.mean([np.var(values) for values in rests]))),
                max(item.trial.acceleration_rounding.of_reading for item in self.trials)
                / math.sqrt(12.0),
            ),
            REST + LEAD,
            _each_reading([item.trial.angle_rounding for item in self.trials]),
            _each_reading([item.trial.position_rounding for item in self.trials]),
        )

    def deviations(
        self, trial: int, shared: FloatArray, local: FloatArray, *, settles: bool = True
    ) -> Deviations:
        """Return how noise of current and sensors moves the outputs of one trial.

        ``settles``: a contact that is still bent before the step may creep.
        """
        return deviations(self, self.noise, trial, shared, local, settles=settles)

    def states(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the states (n, 6) of one trial; columns as in :mod:`.kernel`."""
        return self._run(trial, shared, local, False)[0]

    def simulate(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the outputs (n, 3) of one trial."""
        # Far from the data a trial step may leave the numbers; the fit then takes a shorter one.
        states, _, phase = self._run(trial, shared, local, False)
        own = shared[self.places[trial]]
        radius = self.constants.wheel_radius.value
        return outputs(states, phase, own, local, radius, self.period_s)

    def linearise(
        self, trial: int, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the outputs (n, 3) and their derivatives (n, 3, p + 4)."""
        states, by_q, phase = self._run(trial, shared, local, True)
        own, radius = shared[self.places[trial]], self.constants.wheel_radius.value
        predicted = outputs(states, phase, own, local, radius, self.period_s)
        hurry = self.constants.roller_transitions * self.trials[trial].turning_rad_s
        slopes = output_slopes(
            states, by_q, phase, hurry, own, radius, self._q_slopes(trial, shared, local),
            self.places[trial], len(self.shared), self.period_s,
        )  # fmt: skip
        return predicted, slopes

    def _q_slopes(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the derivatives (2, 19) of :meth:`recursion` to its own unknowns, and to mass."""
        mass = shared[self.places[trial][MASS]]
        moved = list(BY_MASS)
        found = np.zeros((2, DYNAMIC))
        found[0] = 1.0
        found[0, moved] = self.mass_kg(trial) / mass
        found[0, GUIDE] *= self.trials[trial].trial.load
        found[1, moved] = -self.recursion(trial, shared, local)[moved] / mass
        return found

    def _run(
        self, trial: int, shared: FloatArray, local: FloatArray, sensitive: bool
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return states, their derivatives, and the phase of the rollers' transitions (n,)."""
        driven, constants = self.trials[trial], self.constants
        states, by_q = kernel.integrate(
            self.recursion(trial, shared, local), driven.current_a, driven.jumps, driven.angle_rad,
            driven.turning_rad_s, constants.roller_transitions, self.mass_kg(trial),
            self.normal_force_n(trial), self.period_s, sensitive,
        )  # fmt: skip
        turned = driven.angle_rad + shared[WHEEL_DELAY] * driven.turning_rad_s
        return states, by_q, constants.roller_transitions * turned

    def _friction(self) -> tuple[Unknown, ...]:
        found = []
        for parameter, value in zip(PARAMETERS, self.start, strict=True):
            start = float(np.clip(value, parameter.low, parameter.high))
            found.append(
                Unknown(
                    FitParameter(
                        parameter.name, parameter.unit, parameter.low, parameter.high, start,
                        parameter.scaling,
                    )
                )
            )  # fmt: skip
        return tuple(found)

    def _known(self) -> tuple[Unknown, ...]:
        c = self.constants
        return (
            _positive("drive_gain", "N m/A", c.drive_gain, "torque constant, gear and efficiency"),
            _signed("no_load", "N m", c.no_load, "no-load torque and bearings"),
            _signed("wheel_viscous", "N m s", c.viscous, "viscous no-load torque"),
            _positive("wheel_inertia", "kg m^2", c.inertia, "inertia of wheel, gear and motor"),
            _signed("guide_friction", "N", c.guide_friction, "guide friction"),
            _signed("rolling_resistance", "1", c.rolling_resistance, "rolling resistance"),
            _zero("drag", "N s/m", DRAG_N_S_M, "drag of a cable"),
            _zero("slope", "m/s^2", SLOPE_M_S2, "slope of the floor"),
            _positive("wheel_radius", "m", c.wheel_radius, "wheel radius"),
            _zero("current_zero", "A", self._current_zero_u(), "zero of the current"),
            _zero("ripple_cos", "1/s", RIPPLE, "force of the rollers' transitions"),
            _zero("ripple_sin", "1/s", RIPPLE, "force of the rollers' transitions, sine"),
            _zero("wheel_delay", "s", DELAY_S, LATE_SENSORS[0]),
            _zero("carriage_delay", "s", DELAY_S, LATE_SENSORS[1]),
            _zero("acceleration_gain", "1", ACCELERATION_GAIN, "gain of the accelerometer"),
            _zero("acceleration_delay", "s", DELAY_S, LATE_SENSORS[2]),
            _zero("shake_cos", "1/s", RIPPLE, "shaking of the accelerometer, cos"),
            _zero("shake_sin", "1/s", RIPPLE, "shaking of the accelerometer, sin"),
            _zero("shake_2_cos", "1/s", RIPPLE, "shaking of the accelerometer, cos of twice"),
            _zero("shake_2_sin", "1/s", RIPPLE, "shaking of the accelerometer, sin of twice"),
        )

    def _current_zero_u(self) -> float:
        """Return how well the zero is known: a current at rest may be one that flows."""
        return math.hypot(CURRENT_ZERO_A, float(np.median([item.rest_a for item in self.trials])))

    def _mass(self, load: float) -> Unknown:
        stated = self.constants.mass
        value = stated.value * load
        name = "mass" if load == self.trials[0].trial.load else f"mass {value:g} kg"
        return _positive(name, "kg", Known(value, stated.u * load), "mass of the carriage")

    def _of_others(
        self, first: tuple[Unknown, ...]
    ) -> tuple[tuple[Unknown, ...], tuple[NDArray[np.intp], ...]]:
        """Return all shared unknowns, and the places (27,) of those that each trial has."""
        shared, places = list(first), []
        masses = {self.trials[0].trial.load: MASS}
        recordings = {self.trials[0].trial.recording: list(OF_THE_ENCODER)}
        for item in self.trials:
            load, recording = item.trial.load, item.trial.recording
            if load not in masses:
                masses[load] = len(shared)
                shared.append(self._mass(load))
            if recording not in recordings:
                recordings[recording] = [len(shared) + k for k in range(len(OF_THE_ENCODER))]
                shared += [_named(first[place], recording) for place in OF_THE_ENCODER]
            own = np.arange(MASS + 1, dtype=np.intp)
            own[MASS], own[list(OF_THE_ENCODER)] = masses[load], recordings[recording]
            places.append(own)
        return tuple(shared), tuple(places)

    def _local(self) -> tuple[Unknown, ...]:
        counts = [trial.trial.angle_rounding.count for trial in self.trials]
        lines = [trial.trial.position_rounding.count for trial in self.trials]
        return (
            _zero("first_bristle", "1", BRISTLE, ""),
            _zero("first_angle", "rad", max(counts) / math.sqrt(12.0), ""),
            _zero("first_position", "m", max(lines) / math.sqrt(12.0), ""),
            _zero("zero", "m/s^2", ZERO_M_S2, ""),
        )


def driven_trial(trial: LugreTrial, part: slice, window: int, radius_m: float) -> DrivenTrial:
    """Return the ``part`` of ``trial`` that is simulated, its current filtered over ``window``.

    Angle and position count from their means over the rest before the step, acceleration and
    current too: what the monitor shows there is taken for its zero.
    """
    rest = slice(part.start, part.start + LEAD)
    angle = trial.wheel_angle_rad[part] - float(np.mean(trial.wheel_angle_rad[rest]))
    position = trial.carriage_position_m[part] - float(np.mean(trial.carriage_position_m[rest]))
    before = slice(max(0, part.start - REST), part.start + LEAD)
    zero = float(np.mean(trial.motor_current_a[before]))
    current = simulated_current(trial.motor_current_a[part] - zero, window)
    acceleration = trial.acceleration_m_s2[part] - float(np.mean(trial.acceleration_m_s2[before]))
    measured = np.stack([radius_m * angle - position, position, acceleration], axis=1)
    period_s = float(np.median(np.diff(trial.t_s)))
    turning = savgol_filter(angle, TURNING_WINDOW, 2, deriv=1, delta=period_s)
    return DrivenTrial(
        trial.label, current.current_a, current.jumps, trial.wheel_angle_rad[part], turning,
        measured, trial, part, current.noise_a, zero,
    )  # fmt: skip


def period(trials: Sequence[LugreTrial]) -> float:
    """Return the sampling period of the trials in s."""
    return float(np.median(np.diff(trials[0].t_s)))


def _each_reading(rounding: Sequence[Rounding]) -> float:
    """Return the count of readings that are each one sample; 0 if they are means of several."""
    least = min(rounding, key=lambda item: item.of_reading)
    return least.count if least.samples == 1.0 else 0.0


def _named(unknown: Unknown, recording: str) -> Unknown:
    """Return ``unknown`` as one of another recording."""
    parameter = replace(unknown.parameter, name=f"{unknown.parameter.name} of {recording}")
    return replace(unknown, parameter=parameter, wording=f"{unknown.wording}, {recording}")


def _positive(name: str, unit: str, known: Known, wording: str) -> Unknown:
    relative = max(known.u / known.value, LEAST_U)
    # Far enough for a diameter typed for a radius: the data then contradict it.
    parameter = FitParameter(name, unit, known.value / FAR, known.value * FAR, known.value)
    return Unknown(parameter, relative, wording)


def _signed(name: str, unit: str, known: Known, wording: str) -> Unknown:
    u = max(known.u, LEAST_U * abs(known.value), TINY)
    reach = max(REACH * u, 3.0 * abs(known.value))
    parameter = FitParameter(
        name, unit, known.value - reach, known.value + reach, known.value, Scaling.LINEAR
    )
    return Unknown(parameter, u, wording)


def _zero(name: str, unit: str, u: float, wording: str) -> Unknown:
    u = max(u, TINY)
    parameter = FitParameter(name, unit, -REACH * u, REACH * u, 0.0, Scaling.LINEAR)
    return Unknown(parameter, u, wording)
