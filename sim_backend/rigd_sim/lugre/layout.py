"""Defines the order of commands and readings that the LuGre plant shares with its devices.

The indices are plain integers, so that rigd can check a rig file without loading the physics.
"""

from __future__ import annotations

from typing import Final

#: Step of the integrator in ns: 8 steps a millisecond keep the speed within 1e-5 m/s of a
#: reference solution.
STEP_NS: Final = 125_000

#: What devices command, held until the next write: A, 0|1, m/s, 0|1, m/s, 0|1.
COMMANDS: Final = (
    "wheel_current",
    "wheel_enabled",
    "belt_speed",
    "belt_engaged",
    "lateral_speed",
    "lateral_engaged",
)
WHEEL_CURRENT: Final = COMMANDS.index("wheel_current")
WHEEL_ENABLED: Final = COMMANDS.index("wheel_enabled")
BELT_COMMANDS: Final = COMMANDS.index("belt_speed")
LATERAL_COMMANDS: Final = COMMANDS.index("lateral_speed")

#: (name, unit, what it is); the hidden state that verification compares with.
TRUTH: Final = (
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
#: What the sensors show at the time the plant stands at: encoder counts, volts at the card, the
#: two drives' own (m, m/s, N, sum of BELT_* bits), and the hidden state.
READINGS: Final = (
    "motor_counts",
    "guide_counts",
    "acceleration_volts",
    "current_volts",
    "amplifier_status",
    "belt_position",
    "belt_speed",
    "belt_force",
    "belt_status",
    "bridge_position",
    "bridge_speed",
    "bridge_force",
    "bridge_status",
    *(name for name, _, _ in TRUTH),
)
MOTOR_COUNTS: Final = READINGS.index("motor_counts")
GUIDE_COUNTS: Final = READINGS.index("guide_counts")
ACCELERATION_VOLTS: Final = READINGS.index("acceleration_volts")
CURRENT_VOLTS: Final = READINGS.index("current_volts")
AMPLIFIER_STATUS: Final = READINGS.index("amplifier_status")
BELT_READINGS: Final = READINGS.index("belt_position")
BRIDGE_READINGS: Final = READINGS.index("bridge_position")
TRUTH_READINGS: Final = READINGS.index(TRUTH[0][0])

AMPLIFIER_ENABLED: Final = 1
AMPLIFIER_CURRENT_LIMITED: Final = 2  #: the demand exceeds the amplifier's own limit
AMPLIFIER_VOLTAGE_SATURATED: Final = 4  #: the supply cannot drive the demand at this speed

BELT_ENABLED: Final = 1  #: takes setpoints; otherwise braked
BELT_CLUTCHED: Final = 2
BELT_FORCE_LIMITED: Final = 4
BELT_AT_END_STOP: Final = 8
