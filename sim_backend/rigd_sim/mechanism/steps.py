"""Finds how long a step of the integrator may be for the fastest motion of a mechanism."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from rigd_sim.mechanism.amounts import Notes
from rigd_sim.mechanism.bodies import Moving
from rigd_sim.mechanism.description import Description
from rigd_sim.mechanism.network import STEP_NS, Element, Kind

#: A step is at most this over the fastest angular frequency.
OSCILLATION: Final = 0.2
#: And this over the fastest rate at which a falling friction law lets a speed grow, or at which a
#: smoothed one turns round.
GROWTH: Final = 0.3
#: Rounds of the power method; what they leave is far below the margin of OSCILLATION.
ROUNDS: Final = 60
#: Parts of STEP_NS at most: 2 us.
MOST_PARTS: Final = 500


def steps_of(given: Description, bodies: Moving, elements: Sequence[Element], notes: Notes) -> int:
    """Return into how many parts a step of ``STEP_NS`` must be divided.

    Springs, bristles and drives are taken together. A mechanism that is too fast is noted, with the
    body that moves most.
    """
    stiffest, where = _largest(bodies.masses, elements, lambda item: _stiffness(item, given))
    fastest, _ = _largest(bodies.masses, elements, lambda item: _growth(item, given))
    needed = min(
        given.step,
        OSCILLATION / math.sqrt(stiffest) if stiffest > 0.0 else math.inf,
        GROWTH / fastest if fastest > 0.0 else math.inf,
    )
    parts = math.ceil(STEP_NS * 1e-9 / needed * (1.0 - 1e-9))
    if parts > MOST_PARTS:
        frequency = max(math.sqrt(stiffest) / math.tau, fastest / math.tau)
        notes.add(
            ("bodies", bodies.members[where][0]),
            f"what holds this body makes it as fast as {frequency:.3g} Hz, too fast to be "
            f"integrated: softer springs or bristles, a larger 'smooth', or more mass",
        )
        return 1
    return parts


def _largest(
    masses: Sequence[float], elements: Sequence[Element], value: Callable[[Element], float]
) -> tuple[float, int]:
    """Return the largest eigenvalue of M^-1 B^T diag(value) B, and where its mode moves most.

    By the power method on the symmetric form, begun with all modes.
    """
    roots = [math.sqrt(mass) for mass in masses]
    rows = [
        (amount, [(end.dof, end.lever / roots[end.dof]) for end in element.ends])
        for element in elements
        if (amount := value(element)) > 0.0
    ]
    mode = [1.0 + 0.1 * number for number in range(len(masses))]
    for _, ends in rows:
        for dof, lever in ends:
            mode[dof] += lever
    largest = 0.0
    for _ in range(ROUNDS):
        length = math.hypot(*mode) or 1.0
        mode = [item / length for item in mode]
        turned = [0.0] * len(masses)
        for amount, ends in rows:
            force = amount * sum(lever * mode[dof] for dof, lever in ends)
            for dof, lever in ends:
                turned[dof] += lever * force
        largest, mode = math.hypot(*turned), turned
    sizes = [abs(item) for item in mode]
    return largest, sizes.index(max(sizes))


def _load(element: Element, given: Description) -> float:
    most = element.most_load * (given.gravity if element.load_unit == "kg" else 1.0)
    load = max(element.load, most)
    if element.pressed_by:
        load = max(load, 1.0)
    return load


def _stiffness(element: Element, given: Description) -> float:
    numbers = element.numbers
    if element.kind == Kind.BRISTLES:
        return _load(element, given) * numbers["s_0"]
    if element.kind == Kind.CONSTANT or element.kind == Kind.CURRENT:
        return 0.0
    if element.kind == Kind.POSITION:
        return numbers["k"] + numbers["d"] * numbers["outer"]
    return numbers.get("k", 0.0)


def _growth(element: Element, given: Description) -> float:
    """Return the largest force per speed that a friction law gives back, or turns round by."""
    numbers = element.numbers
    if "f_s" not in numbers:
        return 0.0
    falls = (numbers["f_s"] - numbers["f_c"]) / numbers["v_s"]
    turns = 0.5 * numbers["f_s"] / numbers["smooth"] if "smooth" in numbers else 0.0
    return _load(element, given) * max(falls, turns)
