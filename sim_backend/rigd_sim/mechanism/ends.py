"""Finds the displacement that an element acts on: of one body, or of one against another.

An element is a spring, a damper, a friction or a drive. The displacement is a sum of degrees of
freedom, each with a factor.
"""

from __future__ import annotations

from dataclasses import dataclass

from rigd_sim.mechanism.amounts import Notes, Path
from rigd_sim.mechanism.bodies import Moving
from rigd_sim.mechanism.description import GROUND
from rigd_sim.mechanism.network import End


@dataclass(frozen=True)
class Strain:
    """The displacement of the first body less that of the second."""

    ends: tuple[End, ...]
    turns: bool  #: the displacement is an angle, the force a torque
    radius: float = 0.0  #: of the first shaft; 0: none

    @property
    def unit(self) -> str:
        """SI unit of the displacement."""
        return "rad" if self.turns else "m"

    @property
    def force_unit(self) -> str:
        """SI unit of the force."""
        return "N m" if self.turns else "N"

    def force_per(self, factor: str = "") -> str:
        """Return the unit of force per displacement; ``factor`` is ``s`` for a force per speed."""
        return f"{self.force_unit} {factor}".strip() + f"/{self.unit}"


def of_body(path: Path, name: str, bodies: Moving, notes: Notes) -> Strain:
    """Return the displacement of one body against the ground; ``path`` is that of its name.

    Raises:
        Wrong: there is no such body.
    """
    if name == GROUND:
        raise notes.refuse(path, "the ground does not move: it acts on nothing")
    notes.known(path, name, bodies.axes, "body")
    axis = bodies.axes[name]
    return Strain((End(axis.dof, axis.factor),), axis.turns)


def between_two(
    path: Path,
    between: tuple[str, str],
    radius: tuple[float, ...] | None,
    bodies: Moving,
    notes: Notes,
) -> Strain:
    """Return the displacement between two bodies; a shaft counts at its radius, if there is one.

    Raises:
        Wrong: there are no such bodies, or the radii do not fit them.
    """
    for place, name in enumerate(between):
        notes.known((*path, "between", place), name, {*bodies.axes, GROUND}, "body")
    first, second = between
    if first == second:
        raise notes.refuse((*path, "between"), f"both ends are on {first}: it acts on nothing")
    moved = [name for name in between if name != GROUND]
    shafts = [name for name in moved if bodies.axes[name].turns]
    lines = [name for name in moved if not bodies.axes[name].turns]
    if radius is not None and len(radius) != len(shafts):
        plural = "" if len(shafts) == 1 else "s"
        raise notes.refuse((*path, "radius"), f"{len(radius)} for {len(shafts)} shaft{plural}")
    if shafts and lines and radius is None:
        raise notes.refuse(
            path,
            f"{shafts[0]} turns and {lines[0]} moves along a line: give the 'radius' at which "
            f"they touch",
        )
    at = dict(zip(shafts, radius or (), strict=False))
    signs = dict(zip(between, (1.0, -1.0), strict=True))
    ends = tuple(
        End(axis.dof, signs[name] * at.get(name, 1.0) * axis.factor)
        for name, axis in ((name, bodies.axes[name]) for name in moved)
    )
    return Strain(ends, bool(shafts) and radius is None, at[shafts[0]] if at else 0.0)
