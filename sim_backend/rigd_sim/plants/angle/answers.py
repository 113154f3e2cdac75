"""Checks the answers that an operator gives at the rig: numbers, choices, bearing angles."""

from __future__ import annotations

import math

from rigd_sim.plants.angle import layout


def mounted_deg(angle: float) -> float:
    """Return in degrees at which of the known angles the bearings are mounted.

    Raises:
        ValueError: at none of them.

    """
    known = sorted({degrees for degrees, _ in layout.SETS.values()})
    degrees = math.degrees(angle)
    for one in known:
        if abs(degrees - one) < 0.01:
            return float(one)
    raise ValueError(
        f"angle {degrees:g} deg: the bearings can be mounted at {', '.join(map(str, known))} deg"
    )


def number(name: str, value: float | str, unit: str, low: float, high: float) -> float:
    """Return ``value`` of quantity ``name`` in ``unit``.

    Raises:
        ValueError: it is no number from ``low`` to ``high``.

    """
    if isinstance(value, str) or not low <= value <= high:
        raise ValueError(f"{name} {value!r}: expected {low:g} to {high:g} {unit}")
    return float(value)


def choice(name: str, value: float | str, choices: tuple[str, ...]) -> str:
    """Return ``value`` of quantity ``name``.

    Raises:
        ValueError: it is none of ``choices``.

    """
    if value not in choices:
        raise ValueError(f"{name} {value!r}: one of {', '.join(choices)}")
    return str(value)
