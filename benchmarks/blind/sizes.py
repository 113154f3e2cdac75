"""True sizes of what `rigd identify` names at a LuGre rig, for kinds whose name has one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from blind.rig import Rig
from blind.worlds import world

WITHIN: Final = 2.0  # standard errors that a named size may be off


def _gain(rig: Rig) -> float:
    k = rig.true
    return k["torque"] * k["efficiency"] * k["gear"] / rig.sensors.current_gain


def _no_load(rig: Rig) -> float:
    return rig.true["no_load"] * rig.true["efficiency"] * rig.true["gear"] + rig.true["bearing"]


def _viscous(rig: Rig) -> float:
    return rig.true["no_load_viscous"] * rig.true["efficiency"] * rig.true["gear"] ** 2


def _inertia(rig: Rig) -> float:
    k = rig.true
    return k["wheel_inertia"] + k["motor_inertia"] * k["efficiency"] * k["gear"] ** 2


def _late(channel: str) -> Callable[[Rig], float]:
    return lambda rig: rig.sensors.delays[channel]


def _tone(channel: str) -> Callable[[Rig], float]:
    return lambda rig: rig.sensors.tones[channel][0]


#: How the name begins, in which kinds that is the cause, and its size in SI.
SIZES: Final[tuple[tuple[str, tuple[str, ...], Callable[[Rig], float]], ...]] = (
    ("torque constant, gear", ("torque_constant", "gear_efficiency", "monitor gain"), _gain),
    ("no-load torque and bearings", ("no_load_torque",), _no_load),
    ("viscous no-load torque", ("no_load_viscous",), _viscous),
    ("inertia of wheel", ("motor_inertia", "wheel_inertia"), _inertia),
    ("guide friction", ("guide_friction",), lambda rig: rig.true["guide"]),
    ("rolling resistance", ("rolling_resistance",), lambda rig: rig.true["rolling"]),
    ("mass of the carriage", ("mass",), lambda rig: rig.true["mass"]),
    ("wheel radius", ("wheel_radius",), lambda rig: rig.true["radius"]),
    ("slope of the floor", ("slope",), lambda rig: rig.true["slope"]),
    ("drag of a cable", ("cable drag",), lambda rig: rig.true["drag"]),
    ("drag with the square", ("air drag",), lambda rig: rig.true["air"]),
    ("delay of the carriage", ("carriage late", "both encoders late"), _late("position")),
    ("delay of the wheel", ("wheel encoder late", "both encoders late"), _late("angle")),
    ("delay of the accelerometer", ("accelerometer late",), _late("acceleration")),
    ("a delay of the current", ("monitor late",), _late("current")),
    (
        "gain of the accelerometer",
        ("accelerometer gain low", "accelerometer gain high", "accelerometer turned"),
        lambda rig: rig.sensors.acceleration_gain - 1,
    ),
    (
        "a drive wheel out of centre",
        ("eccentric wheel",),
        lambda rig: rig.true["eccentric"] * rig.true["radius"],
    ),
    (
        "an error of the carriage encoder each",
        ("measuring wheel eccentric",),
        lambda rig: rig.sensors.wobble["position"][0],
    ),
    ("friction that repeats", ("friction waves along",), lambda rig: rig.true["wave_size"]),
    ("a shaft between", ("soft coupling",), lambda rig: 1 / rig.true["stiffness"]),
    (
        "another scale of the carriage",
        ("measuring wheel scale",),
        lambda rig: rig.sensors.scales["position"] - 1,
    ),
    ("a hum of 50 Hz on the current", ("mains on the current",), _tone("current")),
    ("a hum of 50 Hz on the acc", ("mains on the accelerometer",), _tone("acceleration")),
    (
        "a zero of the accelerometer that drifts",
        ("accelerometer drifts",),
        lambda rig: rig.sensors.drifts["acceleration"],
    ),
)


def off(row: dict[str, Any]) -> list[tuple[str, float]]:
    """Return each right name of a row with a size, and by how many standard errors it is off."""
    found = []
    for item in row["explanations"]:
        for begin, kinds, size in SIZES:
            if item["name"].startswith(begin) and row["kind"].startswith(kinds):
                truth = size(world(row["kind"], row["size"], row["seed"]))
                found.append((item["name"], (item["size"] - truth) / item["sd"]))
    return found
