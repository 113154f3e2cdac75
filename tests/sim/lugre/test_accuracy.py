"""The compiled integrator against a right-hand side written again from the model's equations.

The reference shares no code with the plant: it is plain Python, solves the lateral loop by
bisection instead of in closed form, and is integrated by LSODA at rtol 1e-9.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import copysign, exp, pi, sin, sqrt, tanh

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from rigd_sim.lugre import kernel, records
from rigd_sim.lugre.parameters import Belt, EndStops, Floor, LugreParameters

EPS = 1e-3
MS = 1e-3
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Inputs:
    current: float = 0.0
    belt: float | None = None  # target speed; None: clutch released
    lateral: float | None = None


Phases = Sequence[tuple[int, Inputs]]
AT_REST = np.zeros(10)


@dataclass(frozen=True)
class Reference:
    """dy/dt of y = (x, v, theta, w, p, i, z, vz, belt_sum, lateral_sum)."""

    rig: LugreParameters
    floor: Floor
    mass: float
    ripple: float = 0.0

    def lateral(self, vz: float) -> float:
        roller = self.rig.wheel.rollers
        s = roller.dry * tanh(vz / EPS) + roller.viscous * vz
        load, height = self.mass * self.rig.gravity, self.rig.carriage.guide.height

        def mismatch(force: float) -> float:
            first = (-load * roller.mass_offset - force * height) / roller.row_distance
            second = load - first
            return force - s * (abs(first) + abs(second))

        return float(brentq(mismatch, -10 * load, 10 * load, xtol=1e-13, rtol=1e-14))

    def __call__(self, y: Sequence[float], u: Inputs) -> list[float]:
        x, v, theta, w, p, i, z, vz, belt_sum, lateral_sum = y
        rig, floor, m = self.rig, self.floor, self.mass
        drive, wheel, guide, bridge = rig.drive, rig.wheel, rig.carriage.guide, rig.bridge
        load = m * rig.gravity

        across = self.lateral(vz)
        moment = load * guide.contact_arm - load * guide.mass_arm - across * guide.height
        right = (-across * guide.half_span - moment) / (2 * guide.half_span)
        left = (-across * guide.half_span + moment) / (2 * guide.half_span)
        drag = (guide.dry * tanh(v / EPS) + guide.viscous * v) * (abs(right) + abs(left))
        rolling = floor.rolling * load * tanh(v / EPS)

        slip = wheel.radius * w - v
        g = floor.mu_coulomb + (floor.mu_static - floor.mu_coulomb) * exp(
            -sqrt(abs(slip) / floor.stribeck_speed)
        )
        dp = slip - floor.sigma_0 * abs(slip) * p / g
        force = load * (floor.sigma_0 * p + floor.sigma_1 * dp + floor.sigma_2 * slip)

        bearing = wheel.bearings
        f_a = (load * (bearing.spacing + bearing.overhang) - across * wheel.radius) / (
            bearing.spacing
        )
        f_b = (load * bearing.overhang - across * wheel.radius) / bearing.spacing
        rim = tanh(wheel.radius * w / EPS)
        t_f = (bearing.dry * rim + bearing.viscous * w) * (abs(f_a) + abs(f_b))
        t_f *= bearing.pitch_diameter / 2
        t_nl = drive.no_load_dry * rim + drive.no_load_viscous * drive.gear_ratio * w
        torque = (drive.torque_constant * i - t_nl) * drive.efficiency * drive.gear_ratio - t_f
        rotor = (drive.rotor_inertia + drive.gear_inertia) * drive.efficiency
        inertia = wheel.inertia + rotor * drive.gear_ratio**2

        emf = drive.back_emf * drive.gear_ratio * w
        goal = min(u.current, (drive.supply - emf) / drive.resistance)
        goal = max(goal, (-drive.supply - emf) / drive.resistance)

        pull, d_belt = self.servo(rig.belts.longitudinal, u.belt, v, belt_sum)
        push, d_lateral = self.servo(rig.belts.lateral, u.lateral, vz, lateral_sum)
        pull += self.buffer(rig.carriage.end_stops, x, v)
        push += self.buffer(bridge.end_stops, z, vz)
        shake = self.ripple * v * sin(wheel.roller_transitions * theta)
        rails = bridge.mass * rig.gravity
        rails *= bridge.rail_dry * tanh(vz / EPS) + bridge.rail_viscous * vz
        return [
            v,
            (force - drag - rolling + pull) / m + shake,
            w,
            (torque - wheel.radius * force) / inertia,
            dp,
            2 * pi * drive.bandwidth * (goal - i),
            vz,
            (push - across - rails) / (m + bridge.mass),
            d_belt,
            d_lateral,
        ]

    @staticmethod
    def servo(belt: Belt, target: float | None, speed: float, total: float) -> tuple[float, float]:
        if target is None:
            return 0.0, 0.0
        error = target - speed
        wanted = belt.proportional * error + belt.integral * total
        if abs(wanted) > belt.force_limit:
            return copysign(belt.force_limit, wanted), error if error * wanted < 0 else 0.0
        return wanted, error

    @staticmethod
    def buffer(stops: EndStops, position: float, speed: float) -> float:
        if position > stops.high:
            return min(0.0, -stops.stiffness * (position - stops.high) - stops.damping * speed)
        if position < stops.low:
            return max(0.0, stops.stiffness * (stops.low - position) - stops.damping * speed)
        return 0.0

    def solve(self, phases: Phases, start: Array = AT_REST) -> Array:
        """Return y at every millisecond of ``phases`` (duration in ms, inputs), shape (n, 10)."""
        y, rows = start, []
        for duration, inputs in phases:

            def rates(_: float, y: Array, inputs: Inputs = inputs) -> list[float]:
                return self(y.tolist(), inputs)

            solution = solve_ivp(
                rates,
                (0.0, duration * MS),
                y,
                "LSODA",
                t_eval=np.arange(1, duration + 1) * MS,
                rtol=1e-9,
                atol=1e-12,
            )
            assert solution.success
            rows.append(solution.y.T)
            y = solution.y[:, -1]
        return np.concatenate(rows)


def compiled(
    reference: Reference, phases: Phases, start: Array = AT_REST, steps_per_ms: int = 8
) -> Array:
    """Return the same rows by the compiled integrator."""
    constants = records.constants(
        reference.rig, reference.floor, reference.mass, noise=False, vibration=reference.ripple > 0
    )
    state, commands = records.state_at_rest(), np.zeros(1, records.COMMANDS)
    state.view(np.float64)[: len(start)] = start
    rows = []
    for duration, inputs in phases:
        commands["wheel_enabled"], commands["wheel_current"] = 1.0, inputs.current
        commands["belt_engaged"] = inputs.belt is not None
        commands["belt_speed"] = inputs.belt or 0.0
        commands["lateral_engaged"] = inputs.lateral is not None
        commands["lateral_speed"] = inputs.lateral or 0.0
        for _ in range(duration):
            kernel.integrate(constants, state, commands, MS / steps_per_ms, steps_per_ms)
            rows.append(state.view(np.float64)[: len(start)].copy())
    return np.array(rows)


def deviations(rig: LugreParameters, reference: Array, result: Array) -> tuple[float, float, float]:
    """Return the largest |dv|, |dslip| and |dv_z| in m/s."""
    difference = result - reference
    slip = rig.wheel.radius * difference[:, 3] - difference[:, 1]
    return (
        float(np.abs(difference[:, 1]).max()),
        float(np.abs(slip).max()),
        float(np.abs(difference[:, 7]).max()),
    )


@pytest.mark.parametrize("floor", ["stone", "pvc", "paperboard"])
def test_a_driven_second_stays_within_the_acceptance_bounds(
    parameters: LugreParameters, floor: str
) -> None:
    """1.35 A from rest: break-away, acceleration, and voltage saturation from 0.6 s on."""
    reference = Reference(parameters, getattr(parameters.floors, floor), 3.9593)
    phases = [(1000, Inputs(current=1.35))]
    exact = reference.solve(phases)
    assert exact[-1, 5] < 1.0, "the second must reach voltage saturation"
    dv, dslip, _ = deviations(parameters, exact, compiled(reference, phases))
    assert dv <= 2e-5
    assert dslip <= 5e-5


@pytest.mark.parametrize("speed", [0.5, -0.5, 0.65])
def test_lateral_motion_stays_within_the_acceptance_bounds(
    parameters: LugreParameters, speed: float
) -> None:
    """The positive speeds lift a row of rollers, 0.65 m/s at a loop gain of 0.68."""
    reference = Reference(parameters, parameters.floors.stone, 3.9593)
    start = np.zeros(10)
    start[6] = 0.6 if speed < 0 else 0.0
    phases = [(150, Inputs(lateral=speed)), (600, Inputs(current=0.9, lateral=speed))]
    exact, result = reference.solve(phases, start), compiled(reference, phases, start)
    assert np.abs(exact[-1, 6] - start[6]) > 0.3, "the bridge must not have met its end stop"
    dv, dslip, dvz = deviations(parameters, exact, result)
    assert dv <= 2e-5
    assert dslip <= 5e-5
    assert dvz <= 1e-4


def test_light_carriage_with_vibration_stays_close(parameters: LugreParameters) -> None:
    reference = Reference(parameters, parameters.floors.pvc, 1.9593, ripple=0.30)
    phases = [(800, Inputs(current=0.9))]
    dv, dslip, _ = deviations(parameters, reference.solve(phases), compiled(reference, phases))
    assert dv <= 2e-5
    assert dslip <= 5e-5


def test_braking_and_return_by_the_belt_stay_close(parameters: LugreParameters) -> None:
    """Force limit, anti-windup and reversal; the limit's corners cost an order of accuracy."""
    reference = Reference(parameters, parameters.floors.stone, 3.9593)
    phases = [
        (400, Inputs(current=1.2)),
        (300, Inputs(belt=0.0)),
        (400, Inputs(belt=-0.5)),
    ]
    dv, dslip, _ = deviations(parameters, reference.solve(phases), compiled(reference, phases))
    assert dv <= 1e-3
    assert dslip <= 1e-3


@pytest.mark.parametrize("floor", ["stone", "pvc", "paperboard"])
def test_splitting_is_of_second_order(parameters: LugreParameters, floor: str) -> None:
    """Halving the step quarters the error, through a step of the current on the way."""
    reference = Reference(parameters, getattr(parameters.floors, floor), 3.9593)
    start = reference.solve([(100, Inputs(current=0.9))])[-1]
    phases = [(200, Inputs(current=1.2))]
    exact = reference.solve(phases, start)
    counts = [4, 8, 16, 32]
    errors = [
        np.abs(compiled(reference, phases, start, count)[:, [1, 3]] - exact[:, [1, 3]]).max()
        for count in counts
    ]
    slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert slope == pytest.approx(-2.0, abs=0.1)
