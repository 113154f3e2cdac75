"""What the analyses of the omni-wheel rig need: signals, constants and their units."""

from __future__ import annotations

from typing import Final

from rigd.analysis import Needs
from rigd_analyses.lugre.trials.known_constants import UNITS

#: What the simulation of the rig takes beside the constants that slip and force need.
DRIVE: Final = (
    *("torque_constant", "gear_ratio", "gear_efficiency"),
    *("no_load_torque", "no_load_viscous", "motor_inertia"),  # at the motor shaft
    # At the wheel; of its bearings the dry torque at `guide_friction_mass`.
    *("wheel_inertia", "bearing_torque"),
    "roller_transitions",  # per revolution of the wheel
)
NEEDS: Final = Needs(
    signals={
        "wheel_angle": "rad",
        "carriage_position": "m",
        "acceleration": "m/s^2",
        "motor_current": "A",
    },
    optional_signals={"carriage_held": "1"},
    constants=("mass", "wheel_radius", "guide_friction", "rolling_resistance", "gravity"),
    optional_constants=(
        "guide_friction_mass",  # that of the trials, if it is left out
        "guide_lift",  # 0 if left out, as much as the guide's friction at most
        *DRIVE,
    ),
    constant_units={**UNITS, "guide_friction_mass": "kg"},
    references=("V_s", "mu_c", "mu_s", "sigma_0", "sigma_1", "sigma_2"),
    trial_parameters=("current",),
)
