"""Where the plant keeps its commands and readings, shared with the devices on it.

Plain integers, so that a rig file can be checked without loading the physics.
"""

from __future__ import annotations

from typing import Final

# Commands: written by the devices, held until the next write.
WHEEL_CURRENT: Final = 0  #: A, demanded of the amplifier
WHEEL_ENABLED: Final = 1  #: 0 or 1
BELT_SPEED: Final = 2  #: m/s, longitudinal
BELT_ENGAGED: Final = 3  #: 0 or 1
LATERAL_SPEED: Final = 4  #: m/s
LATERAL_ENGAGED: Final = 5  #: 0 or 1
COMMANDS: Final = 6

# Readings: what the sensors of the rig show at the time the plant stands at.
MOTOR_COUNTS: Final = 0  #: encoder on the motor shaft, counts
GUIDE_COUNTS: Final = 1  #: encoder of the measuring wheel on the guide, counts
ACCELERATION_VOLTS: Final = 2
CURRENT_VOLTS: Final = 3  #: current monitor of the amplifier
AMPLIFIER_STATUS: Final = 4  #: sum of AMPLIFIER_* bits
BELT: Final = 5  #: position m, speed m/s, force N, sum of BELT_* bits
LATERAL: Final = 9  #: the same for the lateral belt
TRUTH: Final = 13  #: hidden state, in the order of TRUTH_CHANNELS

#: (name, unit, what it is); the hidden state that verification compares with.
TRUTH_CHANNELS: Final = (
    ("carriage_position", "m", "position of the carriage along the guide"),
    ("carriage_speed", "m/s", "speed of the carriage along the guide, v_x"),
    ("wheel_speed", "rad/s", "angular speed of the wheel, w"),
    ("slip_speed", "m/s", "relative speed of the contact, V_r = r w - v_x"),
    ("bristle_deflection", "m", "mean deflection of the bristles, p"),
    ("traction_force", "N", "force of the floor on the wheel, F"),
    ("motor_current", "A", "current in the winding, without sensor errors"),
    ("guide_friction", "N", "friction of the linear guide, F_D"),
    ("rolling_resistance", "N", "rolling resistance of the wheel, F_rol"),
    ("lateral_speed", "m/s", "speed of the bridge across the guide, v_z"),
    ("lateral_force", "N", "lateral friction of the rollers, G"),
)
READINGS: Final = TRUTH + len(TRUTH_CHANNELS)

AMPLIFIER_ENABLED: Final = 1
AMPLIFIER_CURRENT_LIMITED: Final = 2  #: the demand exceeds the amplifier's own limit
AMPLIFIER_VOLTAGE_SATURATED: Final = 4  #: the supply cannot drive the demand at this speed

BELT_ENABLED: Final = 1  #: takes setpoints; otherwise braked
BELT_CLUTCHED: Final = 2
BELT_FORCE_LIMITED: Final = 4
BELT_AT_END_STOP: Final = 8
