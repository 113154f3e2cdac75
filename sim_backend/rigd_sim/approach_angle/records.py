"""Defines the memory of the compiled kernel: one row of constants and one of state, in float64.

The field names are part of the kernel's compiled signature. If a name changes, numba compiles the
kernel again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd_sim.approach_angle.draws import Individual, Run
from rigd_sim.approach_angle.parameters import AngleParameters

#: Friction limit under "no_sliding": rubber on rubber.
RUBBER: Final = 3.0
#: How far "scale_unsteady" moves the reading, in kg.
SHAKE_KG: Final = 0.15


def _doubles(names: str) -> np.dtype[np.void]:
    return np.dtype([(name, np.float64) for name in names.split()])


STATE: Final = _doubles(
    "i rotor rotor_speed wheel w z slid x v y vy "
    # relay: command, since when (s), contact at that time and now; spike on the gauges (strain)
    "command command_at was_closed closed spike "
    # whether the motor ran since the start, how far the surface has relaxed, whether it moves
    "started relaxed awake "
    # scale: what its filter shows (N), readings taken
    "shown_load readings "
    # whether energy is counted, and that supplied and dissipated since then (J)
    "counting supplied dissipated"
)

CONSTANTS: Final = _doubles(
    "voltage back_emf torque_per_current resistance circuit_resistance inductance rotor_inertia "
    "gearbox_drag pick_up bounce drop_out brake "
    "backlash shaft_stiffness shaft_damping clamped arm_torque arm_weight "
    "effective_radius inertia bearing_constant bearing_viscous bearing_load rolling_arm rubbing "
    "rollers profile_rollers profile_sides profile_phase "
    "cosine sine roller_drag mass weight rail_constant rail_load rail_viscous "
    "stop back bumper bumper_stiffness bumper_damping "
    "load rise tilting relaxation relaxation_time vertical_stiffness vertical_damping "
    "limit peak_speed hump speed_floor bristle_stiffness bristle_damping damping_speed convection "
    "breakaway breakaway_slide "
    "shear_per_torque bending_per_load shear_a shear_b bending_a bending_b gauge_phase "
    "gain_a gain_b drift_a drift_b gauge_sensitivity spike spike_time swapped "
    "pot_end pot_volts_per_rad pot_cyclic pulley "
    "wheel_start wheel_slope wheel_phase wheel_pot_dead "
    "platform_start platform_slope platform_phase platform_pot_dead "
    "load_cell_volts_per_n load_cell_zero "
    "gravity known_weight scale_gain scale_noise scale_division scale_shake scale_time "
    "scale_interval"
)


@dataclass(frozen=True)
class Bench:
    """What people have set up at the rig."""

    angle: float  #: approach angle, rad
    limit: float  #: published friction limit of this wheel at this angle; NaN if none is
    load_n: float  #: normal force that the bolts set, N
    voltage: float
    lifted: bool = False  #: the wheel is off the surface
    clamped: bool = False  #: the shaft is clamped
    arm_mass: float = 0.0  #: on the calibration arm, kg
    known_mass: float = 0.0  #: laid on the scale, kg
    rubbing: float = 0.0  #: moment downstream of the gauges, N m
    fault: str = "none"


def constants(
    parameters: AngleParameters, rig: Individual, run: Run, bench: Bench, *, noise: bool, drag: bool
) -> NDArray[np.void]:
    """Return the CONSTANTS row, shape (1,)."""
    row = np.zeros(1, CONSTANTS)
    values = (
        _drive(parameters, bench)
        | _wheel(parameters, rig, bench, noise=noise, drag=drag)
        | _platform(parameters, bench, drag=drag)
        | _normal_force(parameters, run, bench, noise=noise)
        | _contact(parameters, run, bench)
        | _gauges(parameters, rig, run, bench, noise=noise)
        | _potentiometers(parameters, rig, run, bench, noise=noise)
        | _weighing(parameters, rig, bench, noise=noise)
    )
    for name in CONSTANTS.fields or ():
        row[name] = values.pop(name)
    if values:
        raise KeyError(f"constants without a field: {sorted(values)}")
    return row


def _drive(parameters: AngleParameters, bench: Bench) -> dict[str, float]:
    motor, relay, shaft = parameters.motor, parameters.relay, parameters.shaft
    return {
        "voltage": bench.voltage,
        "back_emf": motor.back_emf,
        "torque_per_current": motor.torque_per_current,
        "resistance": motor.resistance,
        "circuit_resistance": motor.resistance + motor.source_resistance,
        "inductance": motor.inductance,
        "rotor_inertia": motor.rotor_inertia,
        "gearbox_drag": motor.gearbox_drag,
        "pick_up": relay.pick_up,
        "bounce": relay.bounce,
        "drop_out": relay.drop_out,
        "brake": float(relay.brake),
        "backlash": shaft.backlash,
        "shaft_stiffness": shaft.stiffness,
        "shaft_damping": shaft.damping,
    }


def _wheel(
    parameters: AngleParameters, rig: Individual, bench: Bench, *, noise: bool, drag: bool
) -> dict[str, float]:
    wheel, arm = parameters.wheel, parameters.calibration_arm
    arm_weight = bench.arm_mass * parameters.gravity
    return {
        "clamped": float(bench.clamped),
        "arm_weight": arm_weight,
        "arm_torque": arm_weight * (arm.length + rig.arm_deviation_m),
        "effective_radius": wheel.radius * (wheel.effective_radius if drag else 1.0),
        "inertia": wheel.inertia,
        "bearing_constant": wheel.bearing_constant * drag,
        "bearing_viscous": wheel.bearing_viscous * drag,
        "bearing_load": wheel.bearing_load * drag,
        "rolling_arm": wheel.rolling_resistance * wheel.radius * drag,
        "rubbing": bench.rubbing,
        "rollers": float(wheel.rollers),
        "profile_rollers": parameters.normal_force.profile_rollers * noise,
        "profile_sides": parameters.normal_force.profile_sides * noise,
        "profile_phase": rig.profile_phase,
        "roller_drag": wheel.roller_drag * drag,
    }


def _platform(parameters: AngleParameters, bench: Bench, *, drag: bool) -> dict[str, float]:
    platform = parameters.platform
    return {
        "cosine": math.cos(bench.angle),
        "sine": math.sin(bench.angle),
        "mass": platform.mass,
        "weight": platform.mass * parameters.gravity,
        "rail_constant": platform.rail_constant * drag,
        "rail_load": platform.rail_load * drag,
        "rail_viscous": platform.rail_viscous * drag,
        "stop": platform.stop,
        "back": platform.back,
        "bumper": platform.bumper,
        "bumper_stiffness": platform.bumper_stiffness,
        "bumper_damping": platform.bumper_damping,
    }


def _normal_force(
    parameters: AngleParameters, run: Run, bench: Bench, *, noise: bool
) -> dict[str, float]:
    force, mass = parameters.normal_force, parameters.platform.mass
    mode = 2 * math.pi * force.vertical_mode
    return {
        "load": 0.0 if bench.lifted else bench.load_n,
        "rise": run.rise,
        "tilting": force.tilting * noise,
        "relaxation": force.relaxation * noise,
        "relaxation_time": force.relaxation_time,
        "vertical_stiffness": mass * mode**2,
        "vertical_damping": 2 * force.vertical_damping * mass * mode,
    }


def _contact(parameters: AngleParameters, run: Run, bench: Bench) -> dict[str, float]:
    contact = parameters.contact
    limit = bench.limit * run.surface
    if bench.fault == "no_sliding" or math.isnan(limit):  # the plant never drives on the latter
        limit = RUBBER
    return {
        "limit": limit,
        "peak_speed": contact.peak_speed,
        "hump": contact.hump,
        "speed_floor": contact.speed_floor,
        "bristle_stiffness": contact.stiffness,
        "bristle_damping": contact.damping,
        "damping_speed": contact.damping_speed,
        "convection": contact.convection,
        "breakaway": contact.breakaway,
        "breakaway_slide": contact.breakaway_slide,
    }


def _gauges(
    parameters: AngleParameters, rig: Individual, run: Run, bench: Bench, *, noise: bool
) -> dict[str, float]:
    gauges, shaft = parameters.gauges, parameters.shaft
    # Strain along phi from the axis: eps_x cos^2 + eps_y sin^2 + gamma sin cos, eps_y = -nu eps_x.
    phi_a = math.pi / 4 + gauges.misalignment_a * noise
    phi_b = -math.pi / 4 + gauges.misalignment_b * noise
    return {
        "shear_per_torque": shaft.radius / (shaft.rigidity * rig.rigidity),
        "bending_per_load": shaft.bend_arm * shaft.radius / shaft.bending_stiffness,
        "shear_a": math.sin(phi_a) * math.cos(phi_a),
        "shear_b": math.sin(phi_b) * math.cos(phi_b),
        "bending_a": math.cos(phi_a) ** 2 - shaft.poisson * math.sin(phi_a) ** 2,
        "bending_b": math.cos(phi_b) ** 2 - shaft.poisson * math.sin(phi_b) ** 2,
        "gauge_phase": rig.gauge_phase + run.wheel_offset,
        "gain_a": rig.gain_a,
        "gain_b": rig.gain_b,
        "drift_a": run.drift_a,
        "drift_b": run.drift_b,
        "gauge_sensitivity": gauges.sensitivity,
        "spike": gauges.spike * noise,
        "spike_time": gauges.spike_time,
        "swapped": float(bench.fault == "gauges_swapped"),
    }


def _potentiometers(
    parameters: AngleParameters, rig: Individual, run: Run, bench: Bench, *, noise: bool
) -> dict[str, float]:
    pots = parameters.potentiometers
    turn = 2 * math.pi
    start = -turn if bench.fault == "wheel_pot_at_end" else pots.wheel_start
    return {
        "pot_end": turn * pots.turns,
        "pot_volts_per_rad": pots.volts_per_rad,
        "pot_cyclic": pots.cyclic * noise,
        "pulley": pots.pulley,
        "wheel_start": start + run.wheel_offset,
        "wheel_slope": rig.wheel_slope,
        "wheel_phase": rig.wheel_phase,
        "wheel_pot_dead": float(bench.fault == "wheel_pot_dead"),
        "platform_start": pots.platform_start + run.platform_offset,
        "platform_slope": rig.platform_slope,
        "platform_phase": rig.platform_phase,
        "platform_pot_dead": float(bench.fault == "platform_pot_dead"),
    }


def _weighing(
    parameters: AngleParameters, rig: Individual, bench: Bench, *, noise: bool
) -> dict[str, float]:
    scale, cell = parameters.scale, parameters.load_cell
    return {
        "load_cell_volts_per_n": cell.sensitivity * rig.load_cell_gain,
        "load_cell_zero": rig.load_cell_zero_v,
        "gravity": parameters.gravity,
        "known_weight": bench.known_mass * parameters.gravity,
        "scale_gain": rig.scale_gain,
        "scale_noise": scale.noise * noise,
        "scale_division": scale.division * noise,
        "scale_shake": SHAKE_KG if bench.fault == "scale_unsteady" else 0.0,
        "scale_time": scale.time_constant,
        "scale_interval": scale.interval,
    }
