"""Finds the coupling from the friction of the guide in each trial, and what the data allow of it.

:mod:`.loads` gives these frictions with their covariance. What is sought is then a problem of eight
parameters whose cost takes no simulation: all of its optima are found, on both sides of each kink,
and profiles of it give intervals that hold beyond a kink, or under another law of a lifted row.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from rigd.analysis.fitting.fit import Fit, fit
from rigd.analysis.fitting.model import (
    FitParameter,
    NormalEquations,
    Scaling,
    scaled_bounds,
    slopes,
    stacked_normal_equations,
    to_natural,
    to_scaled,
)
from rigd.analysis.fitting.uncertainty import scaled_pinv
from rigd.analysis.output_error.score import holm
from rigd.analysis.output_error.system import Unknown
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.result import Explanation, FloatArray
from rigd_analyses.lugre.lateral.coupling import DRY, HEIGHT, LEVER, NAMES, VISCOUS, load
from rigd_analyses.lugre.lateral.coupling_fit.loads import Loads
from rigd_analyses.lugre.lateral.system import LateralSystem
from rigd_analyses.lugre.lateral.thresholds import LATERAL

DRY_GRID = np.geomspace(2e-3, 0.15, 31)
VISCOUS_GRID = np.geomspace(5e-4, 0.3, 31)  #: s/m
#: Relative: by how much the lengths may move each friction, for the choice of starts alone.
LOOSE = 0.05
MOST_STARTS = 6  #: minima on the grid
DRAWS = 6  #: starts around each optimum, beyond kinks that lengths move
SEED = 13
ROLLERS_SD = 0.1  #: of such starts, in the logarithm of the rollers' friction
#: Places of the constants that the rollers' friction rests on: guide friction and the lengths.
RESTS_ON = (0, *range(1 + LEVER, 1 + len(NAMES)))
#: Those that are tested. The load of the guide depends on mu_R times height and on mu_R times half
#: span: with mu_R free, to leave the one or the other to the data is one test.
TESTED = tuple(place for place in RESTS_ON if place != 1 + HEIGHT)
OTHER_VALUES = (0.5, 2.0)  #: times the stated one, from which the data may find another
#: By which share the rollers rub more at positive lateral speeds than on average, and less at
#: negative ones; no law of the coupling has it. It is the ninth parameter where it is sought.
UNEVEN = Unknown(
    FitParameter("unevenness", "1", -0.9, 0.9, 0.0, Scaling.LINEAR),
    wording="unevenness of the rollers (friction at positive lateral speeds over the mean of both "
    "signs, less 1)",
)
UNEVEN_PLACE = 1 + len(NAMES)


@dataclass(frozen=True, eq=False)
class Reduced:
    """Guide friction and coupling (8,) against the forces of trials, as a model of a fit.

    ``unknowns`` (8,) are what is known of them, perhaps with :data:`UNEVEN`. ``samples`` is the
    number of residuals behind ``loads``: half of it is added to the cost, so that
    :mod:`rigd.analysis.fitting.profile` compares it as that of all data. With ``at_m_s`` the two
    parameters of the rollers are mu_R at this lateral speed, and the share of it that is dry.
    """

    loads: Loads
    system: LateralSystem
    unknowns: tuple[Unknown, ...]
    samples: int
    at_m_s: float | None = None
    parameters: tuple[FitParameter, ...] = field(init=False)
    prior: FloatArray = field(init=False, repr=False)
    sds: FloatArray = field(init=False, repr=False)
    mask: FloatArray = field(init=False, repr=False)
    trial_slices: tuple[slice, ...] = ()
    _root: FloatArray = field(init=False, repr=False)  #: root'root is the precision of the forces
    _speeds: FloatArray = field(init=False, repr=False)
    _begins: NDArray[np.intp] = field(init=False, repr=False)
    _counts: NDArray[np.intp] = field(init=False, repr=False)
    _moving: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        system = self.system
        unknowns = list(self.unknowns)
        if self.at_m_s is not None:
            unknowns[1 + DRY], unknowns[1 + VISCOUS] = _at(unknowns, self.at_m_s)
        parameters = tuple(item.parameter for item in unknowns)
        values, vectors = np.linalg.eigh(self.loads.covariance)
        least = 1e-12 * float(values[-1])
        means = np.array([abs(float(np.mean(speed))) for speed in system.speeds])
        counts = [len(speed) for speed in system.speeds]
        for name, value in (
            ("parameters", parameters),
            ("prior", to_scaled(parameters, np.array([item.start for item in parameters]))),
            ("sds", np.array([item.u for item in unknowns])),
            ("mask", np.ones(self.samples)),
            ("_root", (vectors / np.sqrt(np.maximum(values, least))).T),
            ("_speeds", np.concatenate(system.speeds) * (-1.0 if system.turned else 1.0)),
            ("_counts", np.array(counts)),
            ("_begins", np.cumsum([0, *counts[:-1]])),
            ("_moving", means >= LATERAL.min_speed_m_s),
        ):
            object.__setattr__(self, name, value)

    def of(self, trials: Sequence[int]) -> Reduced:
        """Return the problem of these ``trials`` alone, with the residuals behind them."""
        system, loads = self.system, self.loads
        rig = replace(system.rig, trials=tuple(system.rig.trials[k] for k in trials))
        speeds = tuple(system.speeds[k] for k in trials)
        slices = [loads.model.trial_slices[k] for k in trials]
        return replace(
            self,
            loads=loads.of(trials),
            system=replace(system, rig=rig, speeds=speeds),
            samples=sum(part.stop - part.start for part in slices),
        )

    def natural(self, scaled: FloatArray) -> FloatArray:
        """Return scaled parameters (8,) in natural units, within their bounds."""
        low, high = scaled_bounds(self.parameters)
        return to_natural(self.parameters, np.clip(scaled, low, high))

    def coupling(self, theta: FloatArray) -> FloatArray:
        """Return the parameters (7,) of :mod:`.coupling`."""
        out = theta[1:UNEVEN_PLACE].copy()
        if self.at_m_s is not None:
            whole, share = theta[1], theta[2]
            out[DRY], out[VISCOUS] = share * whole, (1.0 - share) * whole / self.at_m_s
        return out

    def as_coupling(self, theta: FloatArray) -> FloatArray:
        """Return guide friction and coupling as in :mod:`.coupling`, (8,): undoes the next."""
        return np.concatenate([theta[:1], self.coupling(theta)])

    def of_coupling(self, coupling: FloatArray) -> FloatArray:
        """Return the parameters (8,) for guide friction and coupling as in :mod:`.coupling`."""
        out = coupling.copy()
        if self.at_m_s is not None:
            dry, viscous = coupling[1 + DRY], coupling[1 + VISCOUS]
            whole = dry + self.at_m_s * viscous
            out[1 + DRY], out[1 + VISCOUS] = whole, dry / whole
        return out

    def forces(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the friction of the guide in each trial in N (t,), and derivatives (t, 8)."""
        system = self.system
        coupling = self.coupling(theta)
        signs = np.sign(self._speeds)
        uneven = np.tile(coupling[:, None], len(signs))
        sides = 1.0 + signs * np.sum(theta[UNEVEN_PLACE:])
        uneven[[DRY, VISCOUS]] *= sides
        found = load(self._speeds, uneven, system.shape)
        radius = system.rig.constants.wheel_radius.value
        torque, moving = system.bearing_torque / radius, self._moving
        guide = np.where(moving, self._means(found.guide), 1.0)
        bearing = np.where(moving, self._means(found.bearing) - 1.0, 0.0)
        shift = torque * bearing - self.loads.free.bearing_nm / radius
        each = theta[0] * found.guide_by + torque * found.bearing_by
        by_side = signs * (each[:, [DRY, VISCOUS]] @ coupling[[DRY, VISCOUS]])
        each[:, [DRY, VISCOUS]] *= sides[:, None]
        each = np.column_stack([each, by_side])[:, : len(theta) - 1]
        by = self._means(each) * moving[:, None]
        if self.at_m_s is not None:
            whole, share, v = theta[1], theta[2], self.at_m_s
            dry, viscous = by[:, DRY].copy(), by[:, VISCOUS].copy()
            by[:, 0] = share * dry + (1.0 - share) / v * viscous
            by[:, 1] = whole * (dry - viscous / v)
        return theta[0] * guide + shift, np.column_stack([guide, by])

    def _means(self, values: FloatArray) -> FloatArray:
        """Return the means of each trial, (t,) of ``values`` (n,), or (t, k)."""
        sums = np.add.reduceat(values, self._begins, axis=0)
        return np.asarray(sums / self._counts.reshape(-1, *[1] * (values.ndim - 1)))

    def residuals(self, theta: FloatArray) -> FloatArray:
        """Return the residuals of the forces and of what is known, (r,)."""
        return self._both(theta)[0]

    def jacobian(self, theta: FloatArray) -> FloatArray:
        """Return d(residuals)/d(theta), (r, 8)."""
        return self._both(theta)[1]

    def cost(self, theta: FloatArray, weights: FloatArray | None = None) -> float:
        """Return half the sum of squares, and half the number of samples."""
        return 0.5 * (float(np.sum(self.residuals(theta) ** 2)) + self.samples)

    def normal_equations(
        self, theta: FloatArray, weights: FloatArray | None = None
    ) -> NormalEquations:
        """Return cost, gradient and information."""
        residuals, jacobian = self._both(theta)
        found = stacked_normal_equations(residuals, jacobian, np.ones(len(residuals)))
        return replace(found, cost=found.cost + 0.5 * self.samples)

    def _both(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        forces, by = self.forces(theta)
        known = np.flatnonzero(np.isfinite(self.sds))
        pulls = (to_scaled(self.parameters, theta) - self.prior)[known] / self.sds[known]
        rows = np.zeros((len(known), len(theta)))
        rows[np.arange(len(known)), known] = (
            1.0 / (self.sds * slopes(self.parameters, theta))[known]
        )
        return (
            np.concatenate([self._root @ (forces - self.loads.forces_n), pulls]),
            np.vstack([self._root @ by, rows]),
        )


def optima(model: Reduced) -> list[Fit]:
    """Return the optima of ``model``, the best first."""
    rng = np.random.default_rng(SEED)
    spread = np.where(np.isfinite(model.sds), model.sds, ROLLERS_SD)
    enough = LATERAL.min_gain_start_ln_l / model.samples
    ends = [fit(model, start, thorough=True, relative_decrease=enough) for start in _starts(model)]
    least = min(end.cost for end in ends)
    for end in [end for end in ends if end.cost < least + LATERAL.max_behind_start_ln_l]:
        for draw in rng.standard_normal((DRAWS, len(spread))):
            theta = model.natural(end.scaled + spread * draw)
            ends.append(fit(model, theta, thorough=True, relative_decrease=enough))
    ends.sort(key=lambda end: end.cost)
    distinct: list[Fit] = []
    for end in ends:
        moved = [np.max(np.abs(end.scaled - other.scaled) / spread) for other in distinct]
        if min(moved, default=math.inf) > LATERAL.max_distance_one_optimum:
            distinct.append(end)
    return distinct


def strained(laws: Sequence[Reduced], coupling: FloatArray) -> Explanation | None:
    """Return which constant explains why one of :data:`RESTS_ON` has moved too far, if one has.

    Residuals as small as noise may hide a wrong constant: if it and the rollers' friction stand in
    for one another, another constant moves, to where chance hardly brings it. So each is left to
    the data in turn. Under the model -2 ln L then gains as chi-square of one degree of freedom
    does; Holm's rule holds the chance of a false alarm of all. The one that gains most is
    returned, with those that the data do not tell apart from it; :data:`UNEVEN` may be among them,
    but is not tested: what it moves, others move as well. ``laws`` are the problem under
    each law, the fitted first; ``coupling`` (8,) is the fitted.
    """
    model = laws[0]
    held = fit(
        model,
        coupling,
        thorough=True,
        relative_decrease=LATERAL.min_gain_start_ln_l / model.samples,
    )
    # Half the lever is another optimum, and under another law: the one that is far from the fit.
    freed = [
        _freed(laws, held, place, everywhere=True)
        if place == 1 + LEVER
        else _freed([model], held, place)
        for place in TESTED
    ]
    if not any(
        holm(
            [float(chi2.sf(max(item.gain, 0.0), 1)) for item in freed], LATERAL.max_p_value_coupling
        )
    ):
        return None
    freed = [_freed(laws, held, place, everywhere=True) for place in RESTS_ON]
    uneven = [replace(law, unknowns=(*law.unknowns, UNEVEN)) for law in laws]
    even = replace(held, theta=np.append(held.theta, 0.0))
    freed.append(replace(_freed(uneven, even, UNEVEN_PLACE, everywhere=True), stated=None))
    first, *others = sorted(freed, key=lambda item: -item.gain)
    as_good = tuple(
        item.name for item in others if item.gain > first.gain - THRESHOLDS.min_gain_told_apart
    )
    return replace(first, others=as_good)


def _freed(
    laws: Sequence[Reduced], held: Fit, place: int, *, everywhere: bool = False
) -> Explanation:
    """Return what the data alone make of a constant: near the fit, or ``everywhere``."""
    unknown = laws[0].unknowns[place]
    stated = unknown.parameter.start
    free = _with(laws[0], place, stated)
    enough = LATERAL.min_gain_start_ln_l / free.samples
    ended = fit(free, held.theta, thorough=True, relative_decrease=enough)
    if everywhere:
        for law, factor in product(laws, (1.0, *OTHER_VALUES)):
            other = _with(law, place, factor * stated)
            end = optima(other)[0]
            if end.cost < ended.cost:
                free, ended = other, end
    scale = slopes(free.parameters, ended.theta)
    inverse = scaled_pinv(free.normal_equations(ended.theta).information * np.outer(scale, scale))
    parameter, value = unknown.parameter, float(ended.theta[place])
    moved = float(ended.scaled[place]) - parameter.scaled(stated)
    return Explanation(
        unknown.wording, parameter.unit, value,
        math.sqrt(float(inverse[place, place])) * parameter.slope(value),
        2.0 * (held.cost - ended.cost), "", stated, moved / unknown.u,
    )  # fmt: skip


def _with(model: Reduced, place: int, start: float) -> Reduced:
    """Return ``model`` without what is stated of one unknown, which begins at ``start``."""
    unknowns = list(model.unknowns)
    parameter = unknowns[place].parameter
    within = min(max(start, parameter.low), parameter.high)
    unknowns[place] = replace(
        unknowns[place], parameter=replace(parameter, start=within), u=math.inf
    )
    return replace(model, unknowns=tuple(unknowns))


def _starts(model: Reduced) -> list[FloatArray]:
    """Return parameters (8,) at the minima of the cost on a grid of the rollers' friction."""
    start = np.array([item.start for item in model.parameters])
    if np.all(np.isfinite(model.sds)):
        return [start]
    system, at = model.system, model.coupling(start)
    means = np.array([float(np.mean(speed)) for speed in system.speeds])
    means = -means if system.turned else means
    moving = np.abs(means) >= LATERAL.min_speed_m_s
    expected = model.loads.forces_n
    loose = np.outer(expected, expected) * LOOSE**2 + np.diag((LOOSE * expected) ** 2)
    precision = np.linalg.inv(model.loads.covariance + loose)
    cost = np.zeros((len(DRY_GRID), len(VISCOUS_GRID)))
    for i, dry in enumerate(DRY_GRID):
        for j, viscous in enumerate(VISCOUS_GRID):
            at[DRY], at[VISCOUS] = dry, viscous
            guide = np.where(moving, load(means, at, system.shape).guide, 1.0)
            error = start[0] * guide - expected
            cost[i, j] = error @ precision @ error
    around = np.pad(cost, 1, constant_values=np.inf)
    shifts = [(i, j) for i in (0, 1, 2) for j in (0, 1, 2) if (i, j) != (1, 1)]
    n, m = cost.shape
    least = np.min([around[i : i + n, j : j + m] for i, j in shifts], axis=0)
    places = np.argwhere(cost <= least)
    places = places[np.argsort(cost[tuple(places.T)])][:MOST_STARTS]
    found = []
    for i, j in places:
        point = np.array([item.parameter.start for item in model.unknowns])
        point[1 + DRY], point[1 + VISCOUS] = DRY_GRID[i], VISCOUS_GRID[j]
        found.append(model.of_coupling(point))
    return found


def _at(unknowns: Sequence[Unknown], speed_m_s: float) -> tuple[Unknown, Unknown]:
    """Return mu_R at a lateral speed and the share of it that is dry, as unknowns."""
    dry, viscous = (unknowns[1 + place].parameter for place in (DRY, VISCOUS))
    whole = FitParameter(
        "mu_R", "1", dry.low + speed_m_s * viscous.low, dry.high + speed_m_s * viscous.high,
        dry.start + speed_m_s * viscous.start,
    )  # fmt: skip
    share = FitParameter("share", "1", 1e-3, 1.0 - 1e-3, dry.start / whole.start, Scaling.LINEAR)
    return Unknown(whole), Unknown(share)
