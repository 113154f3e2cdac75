"""Worlds in which one thing is not as the robot's model and rig file have it, as data.

A world changes the simulated robot, or what is recorded of it, or what is stated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from ruamel.yaml import YAML
from support.articulated.random_robots import RandomRobot, random_robot
from support.recordings.altered import Content

SECOND_NS: Final = 1_000_000_000
MARKERS: Final = ("front_marker", "rear_marker")
STATED: Final = (
    "wheel_radius", "half_track", "half_wheelbase", "hinge_distance", "rotor_inertia", "body_mass",
    "body_inertia", "wheel_mass", "wheel_inertia", "gravity",
)  # fmt: skip


def _unchanged(content: Content) -> None:
    """Leave a recording as it is."""


@dataclass(frozen=True)
class RobotWorld:
    """What is otherwise: of the ``plant`` by dotted names, ``rig`` file, recording, constants.

    ``stated`` multiplies constants, by name. ``named`` are words one of which names the cause.
    """

    named: tuple[str, ...] = ()
    plant: Mapping[str, Any] = field(default_factory=dict)
    rig: Mapping[str, str] = field(default_factory=dict)
    spoil: Callable[[Content], None] = _unchanged
    stated: Mapping[str, float] = field(default_factory=dict)

    @property
    def drives_anew(self) -> bool:
        """Whether the robot must be driven for it; else its recording is another."""
        return bool(self.plant or self.rig)

    def robot(self, number: int, folder: Path) -> RandomRobot:
        """Write the files of the robot with this number in this world to ``folder``."""
        robot = random_robot(number, folder, dict(self.rig))
        path = folder / "plant.yaml"
        plant = YAML().load(path)
        for name, value in self.plant.items():
            *parents, last = name.split(".")
            node = plant
            for parent in parents:
                node = node[parent]
            node[last] = value
        YAML().dump(plant, path)
        return robot

    def written(self, recording: Path, output: Path) -> Path:
        """Write to ``output`` what this world makes of a ``recording``."""
        content = Content.of(recording)
        self.spoil(content)
        constants = content.plan("constants")
        for name, factor in self.stated.items():
            constants[name] *= factor
        content.set_plan("constants", constants)
        return content.write(output)


def _times(**factors: float) -> Callable[[Content], None]:
    """Multiply channels, named as ``stream__channel``; what is raw of them too."""

    def spoil(content: Content) -> None:
        for name, factor in factors.items():
            stream, channel = name.split("__")
            for item in (channel, f"{channel}_raw"):
                rows = content.rows[stream]
                if item in (rows.dtype.names or ()):
                    rows[item] *= factor

    return spoil


def _starts(content: Content) -> list[int]:
    return [int(event.t_ns) for event in content.events if event.kind == "trial_start"]


def _silent(*markers: str, trials: int, seconds: float) -> Callable[[Content], None]:
    """Drop the frames of ``seconds``, 2 s after the begin of the last ``trials`` trials."""

    def spoil(content: Content) -> None:
        for begin in _starts(content)[-trials:]:
            for name in markers:
                rows = content.rows[name]
                since = rows["t_ns"].astype(np.int64) - begin
                off = (since > 2 * SECOND_NS) & (since < (2 + seconds) * SECOND_NS)
                content.rows[name] = rows[~off]

    return spoil


def _exchanged(first: int, after_s: float) -> Callable[[Content], None]:
    """Take both markers for each other from trial ``first`` on, ``after_s`` after each begin."""

    def spoil(content: Content) -> None:
        starts = _starts(content)
        front, rear = (content.rows[name] for name in MARKERS)
        both = np.intersect1d(front["t_ns"], rear["t_ns"])
        begin = np.asarray(starts)[np.searchsorted(starts, both.astype(np.int64), "right") - 1]
        late = both.astype(np.int64) - begin >= after_s * SECOND_NS
        both = both[late & (begin >= starts[first])]
        here, there = (np.searchsorted(rows["t_ns"], both) for rows in (front, rear))
        for item in ("x", "y", "heading"):
            kept = front[item][here].copy()
            front[item][here], rear[item][there] = rear[item][there], kept

    return spoil


def _late(seconds: float) -> Callable[[Content], None]:
    def spoil(content: Content) -> None:
        for name in MARKERS:
            content.rows[name]["t_ns"] += round(seconds * SECOND_NS)

    return spoil


POSITIONS: Final = [f"{marker}__{axis}" for marker in MARKERS for axis in "xy"]
EVERY_SPEED: Final = {"right_motor__speed": 1 / 25.0, "left_motor__speed": 1 / 25.0}

WORLDS: Final[Mapping[str, RobotWorld]] = {
    "right": RobotWorld(),
    "tracker silent for 1 s": RobotWorld(
        spoil=_silent(*MARKERS, trials=4, seconds=1.0)
    ),
    "front marker silent for 1 s": RobotWorld(
        spoil=_silent("front_marker", trials=4, seconds=1.0)
    ),
    "tracker silent for 1 s of a sliding start": RobotWorld(
        spoil=_silent(*MARKERS, trials=8, seconds=1.0)
    ),
    "markers exchanged": RobotWorld(spoil=_exchanged(0, 0.0)),
    "markers exchanged from a trial on": RobotWorld(spoil=_exchanged(6, 0.0)),
    "markers exchanged from 3 s on": RobotWorld(spoil=_exchanged(7, 3.0)),
    "speed of the wheels": RobotWorld(spoil=_times(**EVERY_SPEED)),
    "camera scale y + 1 %": RobotWorld(spoil=_times(front_marker__y=1.01, rear_marker__y=1.01)),
    "camera scale x + 1 %": RobotWorld(spoil=_times(front_marker__x=1.01, rear_marker__x=1.01)),
    "camera scale + 1 %": RobotWorld(
        spoil=_times(**dict.fromkeys(POSITIONS, 1.01))
    ),
    "camera scale + 5 %": RobotWorld(
        spoil=_times(**dict.fromkeys(POSITIONS, 1.05))
    ),
    "camera 50 ms later": RobotWorld(spoil=_late(0.05)),
    "right wheels 2 % larger": RobotWorld(
        spoil=_times(right_motor__speed=1 / 1.02, right_motor__torque=1.02)
    ),
    "right torque + 5 %": RobotWorld(spoil=_times(right_motor__torque=1.05)),
    "torques + 5 %": RobotWorld(spoil=_times(right_motor__torque=1.05, left_motor__torque=1.05)),
    "all constants + 10 %": RobotWorld(stated=dict.fromkeys(STATED, 1.1)),
    "all constants - 10 %": RobotWorld(stated=dict.fromkeys(STATED, 0.9)),
    "hinge at its stop": RobotWorld(plant={"hinge.stop": "40 deg"}),
    "hinge 15 mm further back": RobotWorld(
        named=("hinge",), plant={"modules.front.hinge_behind": "215 mm"}
    ),
    "load transfer": RobotWorld(rig={"loads: equal #": "loads: transfer #"}),
    "vertical": RobotWorld(rig={"loads: equal #": "loads: vertical #"}),
    "smooth law": RobotWorld(rig={"law: paper #": "law: smooth #"}),
    "smooth law, twice the width": RobotWorld(
        rig={"law: paper #": "law: smooth #"}, plant={"friction.width": 0.1}
    ),
    "nothing slides": RobotWorld(rig={"law: paper #": "law: linear #"}),
    **{
        f"{name} stated x {factor:g}": RobotWorld(stated={name: factor})
        for name, factors in {
            "wheel_radius": (0.5, 0.98, 1.02, 2.0),
            "half_track": (0.98, 1.02),
            "half_wheelbase": (0.9, 1.1),
            "hinge_distance": (0.95, 1.05),
            "body_mass": (0.9, 1.1),
            "body_inertia": (1.5,),
            "wheel_mass": (2.0,),
            "gravity": (1.1,),
            "gear_ratio": (0.8, 1.02),
        }.items()
        for factor in factors
    },
}  # fmt: skip
