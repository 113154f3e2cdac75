"""What the analysis of the articulated robot needs: signals, constants and their units."""

from __future__ import annotations

from typing import Final

from rigd.analysis import Needs

MODULES: Final = ("front", "rear")
#: Signals of the motors, and poses of the markers in the order of the system.
MOTORS: Final = ("right_speed", "left_speed")
TORQUES: Final = ("right_torque", "left_torque")
POSES: Final = ("front_x", "front_y", "front_heading", "rear_x", "rear_y", "rear_heading")

NEEDS: Final = Needs(
    signals={
        **dict.fromkeys(MOTORS, "rad/s"),
        **dict.fromkeys(TORQUES, "N m"),
        **{name: "rad" if name.endswith("heading") else "m" for name in POSES},
    },
    constants=(
        *("wheel_radius", "half_track", "half_wheelbase", "hinge_distance", "gear_ratio"),
        *("rotor_inertia", "body_mass", "body_inertia", "wheel_mass", "wheel_inertia"),
        *("gravity", "certain_grip"),
    ),
    constant_units={
        **dict.fromkeys(("wheel_radius", "half_track", "half_wheelbase"), "m"),
        **dict.fromkeys(("body_mass", "wheel_mass"), "kg"),
        **dict.fromkeys(("rotor_inertia", "body_inertia", "wheel_inertia"), "kg m^2"),
        **{"hinge_distance": "m", "gear_ratio": "1", "gravity": "m/s^2", "certain_grip": "1"},
    },
    references=("k_lon", "k_lat", "k_roll", "mu_s", "mu_d"),
)
