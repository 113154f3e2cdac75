"""Defines the memory of the compiled kernel: constants, state, commands and readings, one row each.

All fields are float64 without padding, so that a C struct of doubles has the same layout. The
field names are part of the kernel's compiled signature. If a name changes, numba compiles the
kernel again.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd_sim.lugre import layout
from rigd_sim.lugre.parameters import Belt, EndStops, Floor, LugreParameters

#: How Eq. 26 counts a lifted row of rollers.
COUPLINGS: Final = {"paper": 0.0, "physical": 1.0, "none": 2.0}
#: Card range in V; readings saturate there.
CARD_RANGE_V: Final = 10.0


def _doubles(names: str) -> np.dtype[np.void]:
    return np.dtype([(name, np.float64) for name in names.split()])


STATE: Final = _doubles(
    # carriage position and speed, wheel angle and speed, bristles, motor current,
    # bridge position and speed, the two servos' integrals of the speed error (m)
    "x v theta w p i z vz belt_sum lateral_sum "
    # whether energy is counted, and that supplied and dissipated since then, in J
    "counting supplied dissipated"
)

CONSTANTS: Final = _doubles(
    "mass weight lateral_mass "
    "V_s mu_c mu_s sigma_0 sigma_1 sigma_2 rolling "
    "r inertia transitions ripple smooth "
    "guide_dry guide_viscous guide_moment height half_span "
    "roller_dry roller_viscous row_distance mass_offset coupling "
    "bearing_dry bearing_viscous bearing_arm spacing overhang "
    "rail_dry rail_viscous "
    "gear ratio_efficiency supply torque_constant back_emf resistance loop_rate current_limit "
    "no_load_dry no_load_viscous "
    "belt_kp belt_ki belt_limit belt_speed lateral_kp lateral_ki lateral_limit lateral_speed "
    "x_low x_high x_stiffness x_damping z_low z_high z_stiffness z_damping "
    "step_ns "
    "motor_scale guide_resolution card_resolution card_range "
    "acc_sensitivity acc_noise acc_bias acc_gain acc_shake "
    "monitor_sensitivity monitor_noise monitor_zero "
    "belt_position belt_speed_lsb belt_force_lsb real_sensors"
)
COMMANDS: Final = _doubles(" ".join(layout.COMMANDS))
READINGS: Final = _doubles(" ".join(layout.READINGS))


def state_at_rest() -> NDArray[np.void]:
    """Return a STATE row of zeros, shape (1,)."""
    return np.zeros(1, STATE)


def constants(
    parameters: LugreParameters,
    floor: Floor,
    mass: float,
    *,
    noise: bool,
    vibration: bool,
    step_ns: int = layout.STEP_NS,
) -> NDArray[np.void]:
    """Return the CONSTANTS row, shape (1,), of ``parameters`` with ``mass`` (kg) on ``floor``.

    ``step_ns`` is the longest step of the integrator.
    """
    row = np.zeros(1, CONSTANTS)
    values = (
        _mechanics(parameters, floor, mass, vibration=vibration)
        | _drive(parameters)
        | _servo("belt", parameters.belts.longitudinal)
        | _servo("lateral", parameters.belts.lateral)
        | _stops("x", parameters.carriage.end_stops)
        | _stops("z", parameters.bridge.end_stops)
        | _sensors(parameters, noise=noise, vibration=vibration)
        | {"step_ns": float(step_ns)}
    )
    for name in CONSTANTS.fields or ():
        row[name] = values.pop(name)
    if values:
        raise KeyError(f"constants without a field: {sorted(values)}")
    return row


def _mechanics(
    parameters: LugreParameters, floor: Floor, mass: float, *, vibration: bool
) -> dict[str, float]:
    wheel, guide, bridge = parameters.wheel, parameters.carriage.guide, parameters.bridge
    rollers, bearings, drive = wheel.rollers, wheel.bearings, parameters.drive
    weight = mass * parameters.gravity
    rotor = drive.rotor_inertia + drive.gear_inertia
    rail_load = bridge.mass * parameters.gravity
    return {
        "mass": mass,
        "weight": weight,
        "lateral_mass": mass + bridge.mass,
        "V_s": floor.stribeck_speed,
        "mu_c": floor.mu_coulomb,
        "mu_s": floor.mu_static,
        "sigma_0": floor.sigma_0,
        "sigma_1": floor.sigma_1,
        "sigma_2": floor.sigma_2,
        "rolling": floor.rolling,
        "r": wheel.radius,
        "inertia": wheel.inertia + rotor * drive.efficiency * drive.gear_ratio**2,
        "transitions": float(wheel.roller_transitions),
        "ripple": wheel.force_ripple if vibration else 0.0,
        "smooth": 1e-3,
        "guide_dry": guide.dry,
        "guide_viscous": guide.viscous,
        "guide_moment": weight * (guide.contact_arm - guide.mass_arm),
        "height": guide.height,
        "half_span": guide.half_span,
        "roller_dry": rollers.dry,
        "roller_viscous": rollers.viscous,
        "row_distance": rollers.row_distance,
        "mass_offset": rollers.mass_offset,
        "coupling": COUPLINGS[rollers.coupling],
        "bearing_dry": bearings.dry,
        "bearing_viscous": bearings.viscous,
        "bearing_arm": bearings.pitch_diameter / 2,
        "spacing": bearings.spacing,
        "overhang": bearings.overhang,
        "rail_dry": bridge.rail_dry * rail_load,
        "rail_viscous": bridge.rail_viscous * rail_load,
    }


def _drive(parameters: LugreParameters) -> dict[str, float]:
    drive = parameters.drive
    return {
        "gear": drive.gear_ratio,
        "ratio_efficiency": drive.gear_ratio * drive.efficiency,
        "supply": drive.supply,
        "torque_constant": drive.torque_constant,
        "back_emf": drive.back_emf,
        "resistance": drive.resistance,
        "loop_rate": 2 * math.pi * drive.bandwidth,
        "current_limit": drive.current_limit,
        "no_load_dry": drive.no_load_dry,
        "no_load_viscous": drive.no_load_viscous,
    }


def _servo(name: str, belt: Belt) -> dict[str, float]:
    return {
        f"{name}_kp": belt.proportional,
        f"{name}_ki": belt.integral,
        f"{name}_limit": belt.force_limit,
        f"{name}_speed": belt.speed_limit,
    }


def _stops(axis: str, stops: EndStops) -> dict[str, float]:
    return {
        f"{axis}_low": stops.low,
        f"{axis}_high": stops.high,
        f"{axis}_stiffness": stops.stiffness,
        f"{axis}_damping": stops.damping,
    }


def _sensors(parameters: LugreParameters, *, noise: bool, vibration: bool) -> dict[str, float]:
    sensors = parameters.sensors
    acceleration, monitor = sensors.accelerometer, sensors.current_monitor
    # Ideal sensors keep their nominal scale and lose every error.
    return {
        "motor_scale": sensors.motor_counts * parameters.drive.gear_ratio,
        "guide_resolution": sensors.guide_resolution,
        "card_resolution": sensors.card_resolution,
        "card_range": CARD_RANGE_V,
        "acc_sensitivity": acceleration.sensitivity,
        "acc_noise": acceleration.noise * noise,
        "acc_bias": acceleration.bias * noise,
        "acc_gain": acceleration.gain if noise else 1.0,
        "acc_shake": acceleration.shake if vibration else 0.0,
        "monitor_sensitivity": monitor.sensitivity,
        "monitor_noise": monitor.noise * noise,
        "monitor_zero": monitor.zero * noise,
        "belt_position": sensors.belt_position,
        "belt_speed_lsb": sensors.belt_speed,
        "belt_force_lsb": sensors.belt_force,
        "real_sensors": float(noise),
    }
