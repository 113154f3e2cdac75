"""Estimates the friction of the rails from the way the platform coasts after a push.

The wheel is lifted, so only the rails brake the platform: m dv/dt = -A - B v. A does not depend on
the speed: it is rail_constant plus the share rail_load m g of the platform's own weight. One weight
on the rails cannot separate these two, so the share comes from earlier knowledge.

The equation, integrated twice, is linear in the unknowns and needs no differentiation:
    x = x0 + c t - (A/m) t^2/2 - (B/m) integral of x
Each push has its own x0 and c = v0 + (B/m) x0; A/m and B/m are common to all pushes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigd.analysis.calibration.result import CalibrationResult, Contribution, Measured, Series
from rigd.analysis.result import FloatArray

#: Pushes that the result must stand on: their scatter is its uncertainty.
LEAST_PUSHES = 4
#: From so long after the largest speed, when the hand has surely released it...
LET_GO_S = 0.05
#: ... to this share of it, before the friction at rest begins.
LAST_SHARE = 0.2
#: A slower motion is not a push.
LEAST_SPEED_M_S = 0.1
#: A coast shorter than this does not determine its curvature.
LEAST_COAST_S = 0.25
#: Position that the straight answer may leave unexplained, rms. A potentiometer's error once per
#: turn is 0.1 mm here.
WORST_RMS_M = 1e-3
#: Speeds are means over so long, in s: noise of a potentiometer, not of the platform.
_SMOOTH_S = 0.04
#: Coasts that begin within so much of one another begin on one part of the potentiometer's turn
#: (94 mm on a pulley of 15 mm): its error once per turn is then the same in each.
SPREAD_STARTS_M = 0.04
#: What that error adds, in scatters between the pushes, which do not show it. Of 120 simulated rigs
#: whose pushes all begin at one place, the rms error of the viscous friction was 1.6 scatters (2.1
#: with slower pushes); of those that begin on four parts of the turn, 0.6.
ONE_START = 2.0
#: A value known to no better than half of itself is not known.
KNOWN_AT = 2.0


@dataclass(frozen=True, eq=False)
class Push:
    """Travel (n,) in m at even times (n,) in s, from before the push to after the stop.

    ``start_m`` is the place on the potentiometer at which a coast begins.
    """

    t_s: FloatArray
    x_m: FloatArray
    start_m: float = 0.0


@dataclass(frozen=True)
class RailBench:
    """What is known before the calibration, with standard uncertainties (k = 1)."""

    mass_kg: float
    u_mass: float  #: relative
    gravity: float  #: m/s^2
    u_platform_scale: float  #: of the travel, relative
    rail_load: float  #: share of the load on the rails
    u_rail_load: float


def coast_of(push: Push) -> Push | None:
    """Return the part of ``push`` in which the platform coasts, forwards; None if it does not.

    Time and travel count from its begin.
    """
    step_s = float(push.t_s[1] - push.t_s[0])
    half = max(1, round(0.5 * _SMOOTH_S / step_s))
    if len(push.t_s) <= 2 * half:
        return None
    speed = (push.x_m[2 * half :] - push.x_m[: -2 * half]) / (2 * half * step_s)
    fastest = int(np.argmax(np.abs(speed)))
    if abs(speed[fastest]) < LEAST_SPEED_M_S:
        return None
    speed = speed * np.sign(speed[fastest])
    first = fastest + half + round(LET_GO_S / step_s)
    slow = np.flatnonzero(speed[fastest:] < LAST_SHARE * speed[fastest])
    last = fastest + half + (int(slow[0]) if len(slow) else len(speed) - fastest)
    if (last - first) * step_s < LEAST_COAST_S:
        return None
    sign = np.sign(push.x_m[last - 1] - push.x_m[first])
    part = slice(first, last)
    start_m = float(push.x_m[first])
    return Push(push.t_s[part] - push.t_s[first], sign * (push.x_m[part] - start_m), start_m)


def calibrate_rails(pushes: Sequence[Push], bench: RailBench) -> CalibrationResult:
    """Return the rails' friction that ``pushes`` determine."""
    title = "Friction of the rails"
    coasts = [coast for push in pushes if (coast := coast_of(push)) is not None]
    if len(coasts) < LEAST_PUSHES:
        reason = (
            f"{LEAST_PUSHES} pushes are needed in which the platform coasts for at least "
            f"{LEAST_COAST_S:g} s; there are {len(coasts)} of {len(pushes)}"
        )
        return CalibrationResult(title, {}, refusals=(reason,))
    (a, b), residuals = _fitted(coasts)
    rms_m = float(np.sqrt(np.mean(np.concatenate(residuals) ** 2)))
    constant_n, viscous = bench.mass_kg * a, bench.mass_kg * b
    u_constant, u_viscous = bench.mass_kg * _scatter(coasts)
    starts_m = np.array([coast.start_m for coast in coasts])
    at_one_place = float(np.ptp(starts_m)) < SPREAD_STARTS_M

    def scatter(u: float) -> tuple[Contribution, ...]:
        seen = Contribution("scatter between pushes", u)
        unseen = Contribution("potentiometer, once per turn", ONE_START * u)
        return (seen, unseen) if at_one_place else (seen,)

    load_n = bench.rail_load * bench.mass_kg * bench.gravity
    refusals = []
    if rms_m > WORST_RMS_M:
        refusals.append(
            f"the travel differs by {1e3 * rms_m:.1f} mm rms from that of a platform braked by "
            "rails alone: it ran into something, or was not let go"
        )
    if constant_n - load_n <= 0.0:
        refusals.append(
            f"the rails brake with {constant_n:.3f} N at rest, less than the {load_n:.3f} N that "
            "rail_load of the calibration gives for the platform's own weight: is the wheel lifted?"
        )
    series = tuple(
        Series(
            f"Coast {number}", "travel, m", "measured - fitted, mm",
            item.x_m, 1e3 * residual, np.zeros_like(residual),
        )
        for number, (item, residual) in enumerate(zip(coasts, residuals, strict=True), 1)
    )  # fmt: skip
    if refusals:
        return CalibrationResult(title, {}, series=series, refusals=tuple(refusals))
    common = (  # a longer scale or a heavier platform makes every force larger
        Contribution("mass of the platform", bench.u_mass),
        Contribution("travel per volt", bench.u_platform_scale),
    )
    measured = {
        "rail_constant": Measured(
            constant_n - load_n,
            "N",
            (
                *(Contribution(item.name, item.u * constant_n) for item in common),
                *scatter(u_constant),
                Contribution(
                    "share of the load, as it is known",
                    bench.u_rail_load * bench.mass_kg * bench.gravity,
                ),
            ),
        )
    }
    kept = {
        "rail_load": "one weight on the rails cannot separate it from rail_constant, which is "
        f"the rest of {constant_n:.3f} N when {load_n:.3f} N are put down to it"
    }
    found = Measured(
        viscous,
        "N s/m",
        (Contribution("mass of the platform", bench.u_mass * viscous), *scatter(u_viscous)),
    )
    if viscous > KNOWN_AT * found.u:
        measured["rail_viscous"] = found
    else:
        kept["rail_viscous"] = (
            f"{viscous:.2f} ± {found.u:.2f} N s/m: these pushes do not distinguish it from zero"
        )
    facts = (
        f"{len(coasts)} of {len(pushes)} pushes coast; travel explained to {1e3 * rms_m:.2f} mm "
        f"rms; {constant_n:.3f} N and {viscous:.3f} N s/m brake a platform of {bench.mass_kg:g} kg",
        f"the coasts begin within {1e3 * np.ptp(starts_m):.0f} mm"
        + (
            ": the error of the potentiometer once per turn is nearly the same in each, and counts "
            "as uncertainty. Let the pushes begin at places spread over a turn"
            if at_one_place
            else ", so that the error of the potentiometer once per turn shows as scatter"
        ),
    )
    return CalibrationResult(title, measured, facts, kept, series)


def _fitted(coasts: Sequence[Push]) -> tuple[FloatArray, list[FloatArray]]:
    """Return (A/m, B/m) and the residual of the travel of each coast, by least squares."""
    # x0 and c of each coast are projected out of its rows, which leaves two unknowns for all.
    rows, sides = [], []
    for coast in coasts:
        t, x = coast.t_s, coast.x_m
        own = np.column_stack([np.ones_like(t), t])
        step_s = t[1] - t[0]
        integral = np.concatenate([[0.0], np.cumsum(0.5 * (x[1:] + x[:-1])) * step_s])
        block = np.column_stack([-0.5 * t**2, -integral, x])
        free = block - own @ np.linalg.lstsq(own, block, rcond=None)[0]
        rows.append(free[:, :2])
        sides.append(free[:, 2])
    both = np.linalg.lstsq(np.concatenate(rows), np.concatenate(sides), rcond=None)[0]
    return both, [side - row @ both for row, side in zip(rows, sides, strict=True)]


def _scatter(coasts: Sequence[Push]) -> FloatArray:
    """Return the standard uncertainties of (A/m, B/m): jackknife over whole pushes.

    Residuals within a push hang together (the potentiometer's error once per turn); those of
    pushes that begin elsewhere on the turn do not. Efron and Tibshirani, An Introduction to the
    Bootstrap, Eq. 11.5. Over 120 simulated rigs, four speeds pushed from each of four places, the
    error was 0.6 of it (rms) and within twice of it in 99 %: places at even distances cancel more
    of the error than random ones would.
    """
    without = np.array([_fitted([*coasts[:k], *coasts[k + 1 :]])[0] for k in range(len(coasts))])
    count = len(coasts)
    spread: FloatArray = np.sqrt(
        (count - 1) * np.mean((without - without.mean(axis=0)) ** 2, axis=0)
    )
    return spread
