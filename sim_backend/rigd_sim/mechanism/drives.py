"""Makes the element of a drive, and checks that the drive can reach its own limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from rigd.model.units import format_quantity
from rigd_sim.mechanism.amounts import Notes, Path
from rigd_sim.mechanism.bodies import Moving
from rigd_sim.mechanism.description import Description, Drive
from rigd_sim.mechanism.ends import Strain, of_body
from rigd_sim.mechanism.network import Element, Kind

#: Keys that each mode needs, and those that it may have besides.
KEYS: Final = {
    "current": (("torque_constant",), ("bandwidth", "supply", "resistance")),
    "force": ((), ("bandwidth",)),
    "speed": (("speed_limit", "gain"), ("integral",)),
    "position": (("speed_limit", "gain", "position_gain", "low", "high"), ("integral",)),
}


@dataclass(frozen=True)
class _Setpoint:
    unit: str
    low: float
    high: float


def drive(
    name: str, given: Description, bodies: Moving, elements: tuple[Element, ...], notes: Notes
) -> Element:
    """Return the element of a drive; ``elements`` are those that resist it.

    Raises:
        Wrong: a key is missing or wrong, it acts on nothing, or it cannot reach a limit.
    """
    item, path = given.drives[name], ("drives", name)
    along = of_body((*path, "body"), item.body, bodies, notes)
    _check_keys(path, item, notes)
    setpoint: _Setpoint
    if item.mode in ("current", "force"):
        kind = Kind.CURRENT
        numbers, setpoint = _current(path, item, along, notes)
    else:
        kind = Kind.SPEED if item.mode == "speed" else Kind.POSITION
        numbers, setpoint = _servo(path, item, along, bodies.axes[item.body].start, notes)
        _reaches(path, item, along, numbers, elements, notes)
    return Element(
        name=name, kind=kind, ends=along.ends, numbers=numbers,
        force_unit=along.force_unit, strain_unit=along.unit,
        offset=bodies.axes[item.body].start,
        low=setpoint.low, high=setpoint.high, setpoint_unit=setpoint.unit,
    )  # fmt: skip


def _check_keys(path: Path, item: Drive, notes: Notes) -> None:
    """Refuse a key that the mode of the drive does not have, and an entry that lacks one."""
    needed, more = KEYS[item.mode]
    known = ("body", "mode", "limit", *needed, *more)
    for key in sorted(item.model_fields_set - set(known)):
        raise notes.refuse(
            (*path, key), f"a drive of mode {item.mode} has no '{key}'; it has {', '.join(known)}"
        )
    for key in needed:
        if key not in item.model_fields_set:
            raise notes.refuse(path, f"a drive of mode {item.mode} needs '{key}'")


def _current(
    path: Path, item: Drive, along: Strain, notes: Notes
) -> tuple[dict[str, float], _Setpoint]:
    """Return the numbers, in SI, and the setpoint of a drive under current or force control."""
    unit = "A" if item.mode == "current" else along.force_unit
    limit = notes.amount((*path, "limit"), item.limit, unit, high=1e7, above=True)
    constant = 1.0
    if item.mode == "current":
        constant = notes.amount(
            (*path, "torque_constant"), item.torque_constant, f"{along.force_unit}/A",
            high=1e5, above=True,
        )  # fmt: skip
    numbers = {
        "limit": limit,
        "k": constant,
        "rate": 2 * math.pi * item.bandwidth,
    }
    if (item.supply is None) != (item.resistance is None):
        lacks = "supply" if item.supply is None else "resistance"
        raise notes.refuse(path, f"'supply' and 'resistance' go together: '{lacks}' is missing")
    if item.supply is not None and item.resistance is not None:
        most = item.supply / item.resistance
        if limit > most:
            raise notes.refuse(
                (*path, "limit"),
                f"the drive cannot reach {item.limit}: {item.supply:g} V over "
                f"{item.resistance:g} ohm give {format_quantity(most, 'A')}",
            )
        numbers |= {"supply": item.supply, "resistance": item.resistance}
    return numbers, _Setpoint(unit, -limit, limit)


def _servo(
    path: Path, item: Drive, along: Strain, start: float, notes: Notes
) -> tuple[dict[str, float], _Setpoint]:
    """Return the numbers, in SI, and the setpoint of a drive under speed or position control."""
    unit, force = along.unit, along.force_unit
    limit = notes.amount((*path, "limit"), item.limit, force, high=1e7, above=True)
    fastest = notes.amount(
        (*path, "speed_limit"), item.speed_limit, f"{unit}/s", high=1e6, above=True
    )
    numbers = {
        "limit": limit,
        "fastest": fastest,
        "d": notes.amount((*path, "gain"), item.gain, along.force_per("s"), high=1e8, above=True),
        "k": notes.amount((*path, "integral"), item.integral, along.force_per(), high=1e10),
    }
    if item.mode == "speed":
        return numbers, _Setpoint(f"{unit}/s", -fastest, fastest)
    low = notes.signed((*path, "low"), item.low, unit)
    high = notes.signed((*path, "high"), item.high, unit)
    if not low <= start <= high:
        raise notes.refuse(
            path, f"{item.body} starts at {start:g} {unit}, outside its range of "
            f"{item.low} to {item.high}",
        )  # fmt: skip
    return numbers | {"outer": item.position_gain or 0.0}, _Setpoint(unit, low, high)


def _reaches(
    path: Path,
    item: Drive,
    along: Strain,
    numbers: dict[str, float],
    elements: tuple[Element, ...],
    notes: Notes,
) -> None:
    """Refuse a speed at which the friction of the body takes more than the drive gives."""
    (end,) = along.ends
    speed = numbers["fastest"] / abs(end.lever)  # of the degree of freedom
    taken = 0.0
    for element in elements:
        lever = sum(abs(other.lever) for other in element.ends if other.dof == end.dof)
        taken += lever * resistance(element, lever * speed)
    taken /= abs(end.lever)
    if taken > numbers["limit"]:
        raise notes.refuse(
            (*path, "speed_limit"),
            f"the drive cannot reach {item.speed_limit}: friction takes "
            f"{format_quantity(taken, along.force_unit)} there, and its limit is {item.limit}",
        )


def resistance(element: Element, speed: float) -> float:
    """Return what friction takes at a constant ``speed``, with the load at the start."""
    numbers = element.numbers
    if element.kind not in (Kind.SLIDING, Kind.BRISTLES):
        return 0.0
    force = numbers["visc"] * speed
    if "f_c" in numbers and speed > 0.0:
        fall = math.exp(-((speed / numbers["v_s"]) ** numbers["shape"]))
        force += numbers["f_c"] + (numbers["f_s"] - numbers["f_c"]) * fall
    return element.load * force
