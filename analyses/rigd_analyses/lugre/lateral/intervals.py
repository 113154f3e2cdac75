"""Finds what the data allow of the rollers' friction: profiles under every law that they allow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from rigd.analysis.fitting.model import slopes
from rigd.analysis.fitting.profile import axis, scan
from rigd.analysis.fitting.uncertainty import scaled_pinv
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.lateral.coupling import DRY, VISCOUS
from rigd_analyses.lugre.lateral.coupling_fit.fit import Coupled, fitted
from rigd_analyses.lugre.lateral.coupling_fit.loads import plain
from rigd_analyses.lugre.lateral.coupling_fit.problem import Reduced, optima
from rigd_analyses.lugre.lateral.thresholds import LATERAL

POINTS = 25  #: of a profile
REACH_SD = 4.0  #: to each side of the optima that it is to hold
WIDER = 2.0  #: and how much further if an end is not reached
MOST_WIDER = 3
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Ends:
    """The ends of a 95 % interval of a friction of the rollers; None if the data leave it open."""

    low: float | None
    high: float | None


@dataclass(frozen=True)
class Intervals:
    """The intervals of mu_R_dry, of mu_R_vis, and of mu_R at some lateral speeds."""

    dry: Ends
    viscous: Ends
    at: tuple[Ends, ...]


def intervals(laws: Sequence[Coupled], speeds_m_s: Sequence[float]) -> Intervals:
    """Return what the data allow of mu_R_dry, of mu_R_vis, and of mu_R at lateral speeds.

    ``laws`` are fits under each law of a lifted row, under one noise.
    """
    least = min(law.whole.fit.cost for law in laws)
    allowed = 0.5 * float(chi2.ppf(CONFIDENCE, 1))
    near = [law for law in laws if law.whole.fit.cost - least < allowed]
    found = []
    for law in near:
        problem = law.reduced(plain(law.whole.model.system))
        ends = [fitted(problem, law.coupling), *optima(problem)]
        couplings = [end.theta for end in sorted(ends, key=lambda end: end.cost)]
        found.append(_of_law(law, couplings, law.whole.fit.cost - least, speeds_m_s))
    dry, viscous, *at = (_joined(ends) for ends in zip(*found, strict=True))
    return Intervals(dry, viscous, tuple(at))


def _of_law(
    law: Coupled, couplings: Sequence[FloatArray], worse: float, speeds_m_s: Sequence[float]
) -> list[Ends]:
    """Return the ends of each quantity under one law.

    What one profile accepts, the data allow: the others begin there too, and hold its values. A
    profile of its own may stop at a kink before.
    """
    system = plain(law.whole.model.system)
    problem = law.reduced(system)
    sought = [(problem, 1 + DRY), (problem, 1 + VISCOUS)]
    sought += [(law.reduced(system, speed), 1 + DRY) for speed in speeds_m_s]
    ends: list[Ends] = []
    accepted: list[FloatArray] = []
    for part, place in sought:
        own, more = _profile(part, couplings, accepted, worse, place)
        ends.append(own)
        accepted += more
    return [
        _holding(own, [float(part.of_coupling(item)[place]) for item in accepted])
        for own, (part, place) in zip(ends, sought, strict=True)
    ]


def _holding(ends: Ends, values: Sequence[float]) -> Ends:
    """Return ``ends``, which hold ``values`` too."""
    return Ends(
        None if ends.low is None else min([ends.low, *values]),
        None if ends.high is None else max([ends.high, *values]),
    )


def _joined(ends: Sequence[Ends]) -> Ends:
    """Return what holds every one of ``ends``."""
    low = [item.low for item in ends]
    high = [item.high for item in ends]
    return Ends(
        None if None in low else min(x for x in low if x is not None),
        None if None in high else max(x for x in high if x is not None),
    )


def _profile(
    problem: Reduced,
    couplings: Sequence[FloatArray],
    accepted: Sequence[FloatArray],
    worse: float,
    place: int,
) -> tuple[Ends, list[FloatArray]]:
    """Return the ends of one parameter under a law that is ``worse`` than the best, in ln L.

    ``couplings`` (8,) are the optima under this law, the best first; ``accepted`` (8,) are what
    other profiles accept. What this one accepts is returned too.
    """
    starts = [problem.of_coupling(item) for item in couplings]
    best = fitted(problem, starts[0])
    allowed = 0.5 * float(chi2.ppf(CONFIDENCE, 1))
    held = [
        item for item in starts if problem.cost(item) < best.cost + LATERAL.max_followed * allowed
    ]
    held += [problem.of_coupling(item) for item in accepted]
    parameter = problem.parameters[place]
    values = [
        parameter.scaled(float(item[place]))
        for item in (best.theta, *held)
        if problem.cost(item) <= best.cost + allowed - worse
    ]
    scale = slopes(problem.parameters, best.theta)
    information = problem.normal_equations(best.theta).information * np.outer(scale, scale)
    reach = REACH_SD * math.sqrt(float(scaled_pinv(information)[place, place]))
    box = parameter.scaled(parameter.low), parameter.scaled(parameter.high)
    low, high = min(values), max(values)
    best = replace(best, cost=best.cost - worse)
    for _ in range(MOST_WIDER):
        first, last = max(low - reach, box[0]), min(high + reach, box[1])
        grid = np.linspace(first, last, POINTS)
        found = scan(
            problem, best, axis(len(problem.parameters), place), grid, inflation=1.0,
            others=held,
        )  # fmt: skip
        open_low = found.low is None and first > box[0]
        open_high = found.high is None and last < box[1]
        if not (open_low or open_high):
            break
        low = low - WIDER * reach if open_low else low
        high = high + WIDER * reach if open_high else high
    ends = Ends(
        None if found.low is None else parameter.natural(found.low),
        None if found.high is None else parameter.natural(found.high),
    )
    return ends, [problem.as_coupling(item) for item in found.accepted]
