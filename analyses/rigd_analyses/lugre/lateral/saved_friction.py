"""Carries friction along the guide over from a saved model: what it knows of each parameter."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from rigd.analysis.fitting.identifiability import Z_95
from rigd.analysis.output_error.system import Unknown
from rigd.analysis.validation.saved_models import SavedModel, chosen, differing
from rigd_analyses.lugre.model import MU_C, PARAMETERS, RATIO
from rigd_analyses.lugre.validation.friction import AGAIN, POINT, friction_of

LUGRE: Final = "lugre"
LEAST_U: Final = 1e-4  #: relative: no friction is known better than this


@dataclass(frozen=True)
class Carried:
    """The friction parameters (6) along the guide, with what the model ``name`` knows of them.

    A parameter of which the model gives no number has no uncertainty: it is fitted along.
    """

    name: str
    unknowns: tuple[Unknown, ...]

    @property
    def sentence(self) -> str:
        """What of the model was used."""
        free = [item.parameter.name for item in self.unknowns if math.isinf(item.u)]
        also = f" Fitted along, because it gives no interval: {', '.join(free)}."
        return (
            f"The friction along the guide is that of {self.name}, known as well as its intervals "
            f"show.{also if free else ''}"
        )


def carried(
    models: Sequence[SavedModel], conditions: Mapping[str, str], rigs: tuple[str, ...]
) -> Carried:
    """Return the friction of the one of ``models`` for trials under ``conditions`` on ``rigs``.

    Raises:
        ConfigError: no model is of their conditions and rig, it is of another kind or law, or it
            lacks what this version writes.
    """
    saved = chosen(models, conditions)
    if saved.model != LUGRE:
        raise saved.error(
            f"{saved.name} is a model of {saved.model}: friction along the guide is that of a "
            f"model of {LUGRE}",
            ("model",),
            hint="identify drives without lateral motion, such as constant_current",
        )
    for name in differing(saved, conditions):
        raise saved.error(
            f"{saved.name} is of {name} {saved.conditions[name]}, the trials are of "
            f"{conditions[name]}",
            ("conditions", name),
            hint=f"identify drives on {conditions[name]} for it",
        )
    if saved.get(*POINT) is None and saved.fits:
        raise saved.error(
            f"{saved.name} has no end point of a fit: an earlier version of rigd wrote it, or a "
            "person",
            ("fit",),
            hint=AGAIN,
        )
    names = tuple(item.name for item in PARAMETERS)
    if saved.fits and saved.texts(*POINT, "names") != names:
        raise saved.error(
            f"{saved.name} has another law: the lateral sweep is simulated with the law lugre",
            POINT,
            hint="identify without --law",
        )
    _check_rig(saved, rigs)
    theta = friction_of(saved).theta
    known = [_known(saved, item.name) for item in PARAMETERS]
    # ln(mu_s/mu_c) from both intervals: what they have in common makes it wider, not narrower.
    known[RATIO] = math.hypot(known[MU_C], _known(saved, "mu_s"))
    unknowns = tuple(
        Unknown(
            replace(item, start=min(max(float(value), item.low), item.high)), u,
            f"{item.meaning}, by {saved.name}",
        )
        for item, value, u in zip(PARAMETERS, theta, known, strict=True)
    )  # fmt: skip
    return Carried(saved.name, unknowns)


def _check_rig(saved: SavedModel, rigs: tuple[str, ...]) -> None:
    """Refuse a model of another rig.

    Raises:
        ConfigError: it is of another one, or does not name its own.
    """
    if saved.get("rigs") is None:
        raise saved.error(
            f"{saved.name} does not name its rig: an earlier version of rigd wrote it",
            (),
            hint=AGAIN,
        )
    if saved.texts("rigs") != rigs:
        raise saved.error(
            f"{saved.name} is of the rig {', '.join(saved.texts('rigs'))}, the trials are of "
            f"{', '.join(rigs)}",
            ("rigs",),
            hint="identify drives of the same rig without lateral motion",
        )


def _known(saved: SavedModel, name: str) -> float:
    """Return the standard uncertainty of ln(parameter); infinite if the model has no interval."""
    low, high = (saved.get("parameters", name, end) for end in ("low", "high"))
    numbers = [value for value in (low, high) if isinstance(value, int | float)]
    if len(numbers) < 2 or not 0.0 < numbers[0] < numbers[1]:
        return math.inf
    # The wider side: a normal distribution has no skew.
    middle = min(max(saved.number("parameters", name, "estimate"), numbers[0]), numbers[1])
    wider = max(math.log(numbers[1] / middle), math.log(middle / numbers[0]))
    return max(wider / Z_95, LEAST_U)
