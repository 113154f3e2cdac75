"""Makes degrees of freedom of bodies: those that are coupled rigidly have one in common."""

from __future__ import annotations

from dataclasses import dataclass, field

from rigd_sim.mechanism.amounts import Notes, Wrong
from rigd_sim.mechanism.description import GROUND, Body, Description, Gear
from rigd_sim.mechanism.network import Axis


@dataclass
class Moving:
    """Bodies on their degrees of freedom."""

    axes: dict[str, Axis] = field(default_factory=dict)
    masses: list[float] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    members: list[list[str]] = field(default_factory=list)


def turns(body: Body) -> bool:
    """Return whether it is a shaft."""
    return body.inertia is not None


def moving(given: Description, notes: Notes) -> Moving:
    """Return the bodies; what is wrong is noted."""
    for name, body in given.bodies.items():
        _check_body(name, body, given, notes)
    factors = _coupled(given, notes)
    notes.raise_any()
    result = Moving()
    dofs: dict[str, int] = {}
    for name, body in given.bodies.items():
        root, factor = factors[name]
        dof = dofs.setdefault(root, len(dofs))
        if dof == len(result.masses):
            result.masses.append(0.0)
            result.speeds.append(0.0)
            result.members.append([])
        inertia = body.inertia if turns(body) else body.mass
        result.masses[dof] += (inertia or 0.0) * factor * factor
        result.members[dof].append(name)
        unit = "rad" if turns(body) else "m"
        try:
            start = notes.signed(("bodies", name, "start"), body.start, unit)
            speed = notes.signed(("bodies", name, "speed"), body.speed, f"{unit}/s")
        except Wrong:
            continue
        if speed != 0.0:
            _give_speed(result, dof, name, speed / factor, notes)
        result.axes[name] = Axis(name, dof, factor, start, turns(body))
    for mass, names in zip(result.masses, result.members, strict=True):
        if mass == 0.0:
            notes.add(("bodies", names[0]), _without_mass(names[0], given))
    notes.raise_any()
    return result


def _check_body(name: str, body: Body, given: Description, notes: Notes) -> None:
    """Note what is wrong with the entry of a body by itself."""
    path = ("bodies", name)
    if name == GROUND:
        notes.add(path, "'ground' is what does not move: give this body another name")
    if body.mass is not None and body.inertia is not None:
        notes.add(
            path, f"{name} has a mass and an inertia: it moves along a line or turns, not both"
        )
    if body.mass is None and body.inertia is None:
        notes.add(path, _without_mass(name, given))
    if body.slope != 0.0 and turns(body):
        notes.add((*path, "slope"), f"{name} turns: gravity acts on it by a pendulum alone")


def _without_mass(name: str, given: Description) -> str:
    """Return that a body has no inertia, with what holds it."""
    springs = [key for key, item in given.springs.items() if name in item.between]
    between = f" between {' and '.join(springs)}" if len(springs) > 1 else ""
    return (
        f"{name}{between} has no mass: give its 'mass' if it moves along a line, its 'inertia' if "
        "it turns"
    )


def _give_speed(result: Moving, dof: int, name: str, speed: float, notes: Notes) -> None:
    """Set the initial speed of a degree of freedom; note a contradiction in it."""
    had = result.speeds[dof]
    if had not in (0.0, speed):
        others = ", ".join(item for item in result.members[dof] if item != name)
        notes.add(
            ("bodies", name, "speed"), f"{name} is coupled to {others}, which has another speed"
        )
    result.speeds[dof] = speed


def _coupled(given: Description, notes: Notes) -> dict[str, tuple[str, float]]:
    """Return for each body the first of those it is coupled to, and its displacement over that."""
    found = {name: (name, 1.0) for name in given.bodies}
    through: dict[str, list[str]] = {name: [] for name in given.bodies}
    for name, gear in given.gears.items():
        try:
            factor = _factor(name, gear, given, notes)
        except Wrong:
            continue
        a, b = gear.between
        (root_a, factor_a), (root_b, factor_b) = found[a], found[b]
        if root_a == root_b:
            loop = ", ".join(dict.fromkeys([*through[root_a], name]))
            notes.add(
                ("gears", name),
                f"{name} closes a loop: {a} and {b} are coupled already, through {loop}; remove "
                "one, or make it a spring",
            )
            continue
        # x_b = factor x_a = factor factor_a root_a, and x_b = factor_b root_b
        scale = factor * factor_a / factor_b
        through[root_a] += [*through[root_b], name]
        for body, (root, own) in found.items():
            if root == root_b:
                found[body] = (root_a, own * scale)
    return found


def _factor(name: str, gear: Gear, given: Description, notes: Notes) -> float:
    """Return the displacement of the second body per displacement of the first."""
    path = ("gears", name)
    for place, body in enumerate(gear.between):
        if body == GROUND:
            raise notes.refuse(
                (*path, "between", place),
                "coupled to the ground it cannot move: remove the body, or use a spring",
            )
        notes.known((*path, "between", place), body, given.bodies, "body")
    a, b = gear.between
    if a == b:
        raise notes.refuse((*path, "between"), f"{a} is coupled to itself")
    if turns(given.bodies[a]) == turns(given.bodies[b]):
        if gear.radius is not None:
            raise notes.refuse((*path, "radius"), f"{a} and {b} move alike: give a 'ratio'")
        if not gear.ratio or abs(gear.ratio) < 1e-4:
            raise notes.refuse(path, f"give the 'ratio': ways of {a} per way of {b}, at least 1e-4")
        return 1.0 / gear.ratio
    if gear.ratio is not None:
        raise notes.refuse((*path, "ratio"), "a shaft and a body on a line have a 'radius'")
    if gear.radius is None:
        raise notes.refuse(path, "give the 'radius': travel of the body per rad of the shaft")
    return gear.radius if turns(given.bodies[a]) else 1.0 / gear.radius
