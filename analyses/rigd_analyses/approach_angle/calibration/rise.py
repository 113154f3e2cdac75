"""Estimates the rise of the normal force along the rails from the scale at both ends of the travel.

If the rails are not quite parallel to the ground, the load of the wheel changes with the travel:
N = N_0 (1 + load_rise x). The scale is too slow to measure the change in a run. The operator
therefore pushes the platform to the far end, the scale is read there, and the operator brings the
platform back. The module averages the readings at the start before and after the push. Then neither
a ground that gives way with time nor the span of the scale has an effect.

Each push gives a rise of its own, and so does each run, because platform and ground never meet in
quite the same way. ``load_rise`` is the mean that a campaign of many runs needs, and its
uncertainty is that of the mean. The result also states how far a single run departs from the mean;
this is a part of the scatter between the runs of a campaign.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigd.analysis.calibration.result import CalibrationResult, Contribution, Measured, Series
from rigd.analysis.result import FloatArray

#: Loads, and pushes under each, that the result must stand on: their scatter is its uncertainty.
LEAST_LOADS = 2
LEAST_PUSHES = 3
#: A travel shorter than this does not determine a rise along it.
LEAST_TRAVEL_M = 0.1
#: How far the scale may be from the announced load, as a share of it.
MOST_LOAD_ERROR = 0.1
#: Share of the load by which it may differ once the platform is back; the ground gives way by 1 %.
MOST_LEFT = 0.02
#: Share of the load by which a push may differ from the others at the end of the travel.
MOST_APART = 0.05


@dataclass(frozen=True, eq=False)
class Push:
    """One push there and back: mean readings at start, end, and start again, (3,) each."""

    announced_kg: float  #: load of the wheel
    shown_kg: FloatArray  #: by the scale, which is tared without the wheel
    position_m: FloatArray  #: of the platform, from any zero

    @property
    def load_kg(self) -> float:
        """What the scale shows at the start: the mean of before and after."""
        return 0.5 * float(self.shown_kg[0] + self.shown_kg[2])

    @property
    def left_kg(self) -> float:
        """What it shows more once the platform is back."""
        return float(self.shown_kg[2] - self.shown_kg[0])

    @property
    def travel_m(self) -> float:
        """From the start to the end."""
        return float(self.position_m[1]) - 0.5 * float(self.position_m[0] + self.position_m[2])

    @property
    def gained_kg(self) -> float:
        """What the scale shows more at the end than at the start."""
        return float(self.shown_kg[1]) - self.load_kg

    @property
    def rise(self) -> float:
        """Relative rise of the load per travel, 1/m."""
        return self.gained_kg / (self.load_kg * self.travel_m)


def calibrate_rise(
    pushes: Sequence[Push], *, u_travel: float, division_kg: float
) -> CalibrationResult:
    """Return the rise of the load that ``pushes`` determine.

    ``u_travel`` is the relative standard uncertainty of a travel, ``division_kg`` the scale's.
    """
    title = "Rise of the load along the rails"
    groups = _by_load(pushes)
    refusals = _too_little(groups) or _bad_pushes(pushes)
    if refusals:
        return CalibrationResult(title, {}, refusals=refusals)
    rise = float(np.mean([push.rise for push in pushes]))
    travel_m = float(np.mean([push.travel_m for push in pushes]))
    series = Series(
        "What the scale shows more at the end", "load, kg", "gained, g",
        np.array([push.load_kg for push in pushes]),
        1e3 * np.array([push.gained_kg for push in pushes]),
        1e3 * np.array([rise * push.travel_m * push.load_kg for push in pushes]),
    )  # fmt: skip
    refusals = _outliers(pushes)
    if refusals:
        return CalibrationResult(title, {}, series=(series,), refusals=refusals)
    scatter, freedom = _scatter(groups)
    # With few pushes their scatter is itself uncertain: a mean then has the t-distribution, which
    # is this much wider than the normal one (JCGM 101:2008, 6.4.9.7).
    u_mean = scatter / math.sqrt(len(pushes)) * math.sqrt(freedom / (freedom - 2))
    # Each rise stands on an end and the mean of two starts, rounded to divisions. Noise below half
    # a division does not spread the rounding, so that of one push counts in full.
    rounding_kg = math.sqrt(1.5) * division_kg / math.sqrt(12.0)
    u_rounding = rounding_kg * float(np.mean([1.0 / (p.load_kg * p.travel_m) for p in pushes]))
    budget = (
        Contribution("scatter between pushes", u_mean),
        Contribution("difference between the loads", _between(groups, scatter)),
        Contribution("rounding to divisions", u_rounding),
        Contribution("travel per volt", abs(rise) * u_travel),
    )
    loads = "; ".join(
        f"at {load_kg:g} kg {_mean_rise(own):+.3f} ± {scatter / math.sqrt(len(own)):.3f} 1/m"
        for load_kg, own in groups.items()
    )
    facts = (
        f"{len(pushes)} pushes of {travel_m:.3f} m, over which the load rises by "
        f"{rise * travel_m:+.1%}; one push departs from that by {scatter * travel_m:.1%} of the "
        "load, and so may one run",
        loads,
        "back at the start the scale shows as before to within "
        f"{1e3 * max(abs(push.left_kg) for push in pushes):.1f} g",
    )
    return CalibrationResult(
        title, {"load_rise": Measured(rise, "1/m", budget)}, facts, series=(series,)
    )


def _by_load(pushes: Sequence[Push]) -> dict[float, list[Push]]:
    """Return the pushes by announced load, the lightest first."""
    groups: dict[float, list[Push]] = {}
    for push in sorted(pushes, key=lambda item: item.announced_kg):
        groups.setdefault(push.announced_kg, []).append(push)
    return groups


def _mean_rise(pushes: Sequence[Push]) -> float:
    return float(np.mean([push.rise for push in pushes]))


def _scatter(groups: dict[float, list[Push]]) -> tuple[float, int]:
    """Return the standard deviation of a push among those of its load, and its freedom."""
    squares = [(item.rise - _mean_rise(own)) ** 2 for own in groups.values() for item in own]
    freedom = len(squares) - len(groups)
    return math.sqrt(math.fsum(squares) / freedom), freedom


def _between(groups: dict[float, list[Push]], scatter: float) -> float:
    """Return by how much the rise differs from load to load beyond what the scatter explains."""
    means = [_mean_rise(own) for own in groups.values()]
    explained = scatter**2 * float(np.mean([1.0 / len(own) for own in groups.values()]))
    return math.sqrt(max(0.0, float(np.var(means, ddof=1)) - explained))


def _too_little(groups: dict[float, list[Push]]) -> tuple[str, ...]:
    """Return why there are not enough pushes."""
    if len(groups) >= LEAST_LOADS and min(map(len, groups.values())) >= LEAST_PUSHES:
        return ()
    found = ", ".join(f"{len(own)} under {load_kg:g} kg" for load_kg, own in groups.items())
    return (
        f"{LEAST_PUSHES} pushes are needed under each of at least {LEAST_LOADS} loads; there are "
        f"{found or 'none'}",
    )


def _bad_pushes(pushes: Sequence[Push]) -> tuple[str, ...]:
    """Return what is wrong with single pushes."""
    found = []
    for number, push in enumerate(pushes, 1):
        if abs(push.load_kg - push.announced_kg) > MOST_LOAD_ERROR * push.announced_kg:
            found.append(
                f"push {number}: the scale shows {push.load_kg:.2f} kg while {push.announced_kg:g} "
                "kg were announced: is the wheel on the surface, was the scale tared without it?"
            )
        elif push.travel_m < LEAST_TRAVEL_M:
            found.append(
                f"push {number}: the platform went by {1e3 * push.travel_m:.0f} mm, less than "
                f"{1e3 * LEAST_TRAVEL_M:.0f} mm: it was not pushed to its end and back, its thread "
                "is off, or its potentiometer is wired the wrong way round"
            )
        elif abs(push.left_kg) > MOST_LEFT * push.load_kg:
            found.append(
                f"push {number}: back at the start the scale shows {1e3 * push.left_kg:+.0f} g, "
                f"more than {MOST_LEFT:.0%} of the load: the bolts gave way, a hand was on the "
                "platform, or the wheel was dragged instead of rolled"
            )
    return tuple(found)


def _outliers(pushes: Sequence[Push]) -> tuple[str, ...]:
    """Return which pushes contradict the others."""
    middle = float(np.median([push.rise for push in pushes]))
    return tuple(
        f"push {number}: the load rises by {push.rise * push.travel_m:+.1%}, the others by "
        f"{middle * push.travel_m:+.1%}: something touched the platform or the scale"
        for number, push in enumerate(pushes, 1)
        if abs(push.rise - middle) * push.travel_m > MOST_APART
    )
