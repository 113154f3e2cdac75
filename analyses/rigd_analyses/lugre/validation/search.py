"""Searches the fewest constants that must have other values for a model to explain a recording.

The order is: no constant; one constant, first the drive's gain and the zero of the current; these
two together; one further constant beside them. A constant that must change by more than three of
its uncertainties explains nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rigd_analyses.lugre.rig.system import CURRENT_ZERO_A, DELAY_S
from rigd_analyses.lugre.validation.attempt import (
    BY_SLIP,
    DRIVE,
    Attempt,
    attempt,
    model_doubts,
    predicted_excess,
)
from rigd_analyses.lugre.validation.friction import Friction
from rigd_analyses.lugre.validation.motion import (
    GAIN,
    LATE,
    ZERO,
    DrivenMotion,
    uncertainties,
)

PLAUSIBLE: Final = 3.0  #: of its standard uncertainties, that a constant may be off
#: The same for gain and zero of the drive, which a validation is there to find: with the current's
#: zero known to 3 mA, 10 mA are 3.3 of them.
PLAUSIBLE_DRIVE: Final = 5.0
REACH: Final = 8.0  #: of its uncertainties, that a fit may move a constant
#: The gain by a factor of four, the zero by an ampere: a fit finds what was typed wrong.
DRIVE_REACH: Final = {GAIN: math.log(4.0), ZERO: 1.0}
HOPE: Final = 2.0  #: an attempt is made if its predicted excess is below; its slopes are not exact


@dataclass(frozen=True, eq=False)
class Search:
    """``stated`` is the attempt without any change, ``found`` the one to report.

    ``equal`` are other attempts with as many constants that explain the recording as well;
    ``suspects`` would explain it with an implausible constant, if nothing else does.
    """

    stated: Attempt
    found: Attempt
    equal: tuple[Attempt, ...] = ()
    suspects: tuple[Attempt, ...] = ()

    @property
    def explained(self) -> bool:
        """Whether the recording is explained by what was found."""
        return self.found.passes


def search(motions: Sequence[DrivenMotion], friction: Friction) -> Search:
    """Return the fewest constants that explain ``motions``, trials of one recording."""
    doubts = model_doubts(motions, friction)
    known = tuple(uncertainties(motions[0]))
    reach = {name: REACH * stated_u(motions[0], name) for name in (*known, *BY_SLIP)}
    reach |= DRIVE_REACH

    def tried(*names: str) -> Attempt:
        return attempt(motions, friction, names, doubts, reach)

    def promising(start: Attempt, names: Sequence[str]) -> list[str]:
        return [name for name in names if predicted_excess(start, name) < HOPE]

    first = tried()
    if first.passes:
        return Search(first, first)
    drive = [tried(name) for name in DRIVE]
    others = [tried(name) for name in promising(first, (*known, *BY_SLIP))]
    # The drive before the others: to find its bias is what a validation is for.
    if passing := [*_plausible(drive), *_plausible(others)]:
        return Search(first, passing[0], tuple(passing[1:]))
    both = tried(*DRIVE)
    if both.passes:
        return Search(first, both)
    further = [tried(*DRIVE, name) for name in promising(both, (*known, *BY_SLIP))]
    if passing := _plausible(further):
        return Search(first, passing[0], tuple(passing[1:]))
    suspects = [item for item in (*others, *further) if item.passes]
    suspects.sort(key=lambda item: item.excess)
    return Search(first, both, suspects=tuple(suspects))


def stated_u(motion: DrivenMotion, name: str) -> float:
    """Return the standard uncertainty of a constant, of the drive's gain that of its logarithm."""
    c = motion.constants
    if name == GAIN:
        return c.drive_gain.u / c.drive_gain.value
    if name == ZERO:
        return CURRENT_ZERO_A
    if name == LATE:
        return DELAY_S
    if name == "wheel_radius":
        return c.wheel_radius.u
    return uncertainties(motion)[name]


def pull(item: Attempt, name: str) -> float:
    """Return by how many of its uncertainties ``name`` is off; infinite if none is stated."""
    u = stated_u(item.simulated[0].motion, name)
    return abs(item.value(name)) / u if u > 0.0 else np.inf


def _plausible(attempts: Sequence[Attempt]) -> list[Attempt]:
    """Return those that explain the recording, the best first."""
    found = [
        item
        for item in attempts
        if item.passes
        and all(pull(item, name) <= PLAUSIBLE for name in item.names if name not in DRIVE)
    ]
    return sorted(found, key=lambda item: item.excess)
