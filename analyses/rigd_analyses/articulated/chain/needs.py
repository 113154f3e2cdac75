"""What the analysis of a chain of modules needs: signals and constants of each, and their units."""

from __future__ import annotations

from typing import Final

from rigd.analysis import Needs

MOST_MODULES: Final = 8
#: Which wheels a motor may turn, with the side (0 is right) and how many they are: the two of a
#: side, which are geared together, or one of them.
WHEELS: Final = {
    "right": (0, 2), "left": (1, 2), "front_right": (0, 1), "front_left": (1, 1),
    "rear_right": (0, 1), "rear_left": (1, 1),
}  # fmt: skip
AXES: Final = {"x": "m", "y": "m", "heading": "rad"}
KINDS: Final = ("k_lon", "k_lat", "k_roll")
#: Constants of a module; one of a single module stands as `module_2_body_mass` before that of all.
OF_MODULE: Final = {
    "wheel_radius": "m", "half_track": "m", "half_wheelbase": "m", "body_mass": "kg",
    "body_inertia": "kg m^2", "wheel_mass": "kg", "wheel_inertia": "kg m^2", "gear_ratio": "1",
}  # fmt: skip
#: Distances from the centre of a module to its hinges, and what stands for them.
HINGES: Final = {"hinge_ahead": "m", "hinge_behind": "m", "hinge_distance": "m"}
OF_ROBOT: Final = {
    "modules": "1", "motors": "1", "rotor_inertia": "kg m^2", "gravity": "m/s^2",
    "certain_grip": "1",
}  # fmt: skip
NUMBERS: Final = range(1, MOST_MODULES + 1)


def of_module(number: int, name: str) -> str:
    """Return the name of a signal or constant of the module with this number, from 1."""
    return f"module_{number}_{name}"


_SINGLE: Final = {
    of_module(number, name): unit
    for number in NUMBERS
    for name, unit in (OF_MODULE | HINGES).items()
}
_POSES: Final = {of_module(n, axis): unit for n in NUMBERS for axis, unit in AXES.items()}
_FIRST: Final = {of_module(1, axis): unit for axis, unit in AXES.items()}

NEEDS: Final = Needs(
    signals=_FIRST,
    optional_signals={
        **{name: unit for name, unit in _POSES.items() if name not in _FIRST},
        **{
            of_module(number, f"{wheels}_{name}"): unit
            for number in NUMBERS
            for wheels in WHEELS
            for name, unit in (("speed", "rad/s"), ("torque", "N m"))
        },
    },
    constants=(*OF_ROBOT, *OF_MODULE),
    optional_constants=("hinge_distance", *_SINGLE),
    constant_units={**OF_ROBOT, **OF_MODULE, "hinge_distance": "m", **_SINGLE},
    references=(*KINDS, *(f"{kind}_{number}" for kind in KINDS for number in NUMBERS)),
)
