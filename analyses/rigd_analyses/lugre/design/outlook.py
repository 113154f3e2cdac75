"""Predicts what one more test would tell of the friction of a fit, by output error itself.

The tests stay within what the recordings reach: their currents, travel and speed. Each is taken as
a recording of its own, whose encoder begins at another angle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from rigd.analysis.fitting.identifiability import Z_95
from rigd.analysis.fitting.model import slopes
from rigd.analysis.fitting.uncertainty import scaled_pinv
from rigd.analysis.output_error.augmented_system import own_parameters
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.curve import TRIM
from rigd_analyses.lugre.design.motion import BRAKE_M_S2, Limits, Motion, Sensors, refusal
from rigd_analyses.lugre.design.shapes import Kind, Shape
from rigd_analyses.lugre.design.subject import QUANTITIES, Subject, slip_of
from rigd_analyses.lugre.model import PARAMETERS, RATIO, V_S, friction, friction_gradient
from rigd_analyses.lugre.quantities import STRIBECK_SPEED, TOTAL_DAMPING
from rigd_analyses.lugre.rig import sensors as rows
from rigd_analyses.lugre.rig.outputs import TRAVEL
from rigd_analyses.lugre.rig.ridge import SHOWN
from rigd_analyses.lugre.rig.standard_errors import FRICTION, HEIGHT, RigIdentification
from rigd_analyses.lugre.rig.system import GUIDE, MASS, NO_LOAD, OF_THE_ENCODER, RigSystem
from rigd_analyses.lugre.trials.known_constants import Known

ALL = {**QUANTITIES, HEIGHT.name: HEIGHT, TOTAL_DAMPING.name: TOTAL_DAMPING}
RISING = (STRIBECK_SPEED.name, HEIGHT.name)  #: what there is with a Stribeck effect only
#: Of the largest current. Held, it would reach the voltage limit, as the recordings do.
HOLDS, LIGHT_HOLDS, RAMP, BACK = (0.25, 0.4, 0.6), (0.25, 0.5), (0.2, 0.6), -0.6
LIGHT = 0.5  #: share of the carriage's mass
SWING_HZ, SWING_S, RAMP_S, BACK_S = 1.2, 3.0, 3.0, 1.0
TURN = 0.4  #: of the travel, where a current changes
FASTER, AROUND_M = 1.02, 0.01  #: how far a prediction may be off, of speed and travel
#: Standard errors from which a Stribeck effect is shown: without one there is no V_s.
EFFECT = math.sqrt(float(chi2.ppf(SHOWN, 2)))
TWO = float(chi2.ppf(0.95, 2))  #: an open V_s comes with the height of its effect


@dataclass(frozen=True)
class FurtherShape:
    """A test in ``words``; without a ``shape`` it is all tests at hand again."""

    words: str
    shape: Shape | None
    load: float = 1.0


@dataclass(frozen=True, eq=False)
class Point:
    """Friction and constants that the data accept, and (26, 26) the information on them, scaled."""

    subject: Subject
    known: FloatArray


@dataclass(frozen=True, eq=False)
class _Motion:
    """How a test moves at a point, and the slip (low, high) in m/s that the data then have."""

    subject: Subject
    motion: Motion | None
    visited: tuple[float, float]


class Outlook:
    """What further tests would make of the fit ``found``."""

    def __init__(self, found: RigIdentification) -> None:
        system = found.family.system
        self._found, self._system = found, system
        self._count = sum(len(error) for error in found.whole.errors)
        self._motions: dict[tuple[FurtherShape, Point], _Motion | None] = {}
        self._added: dict[tuple[FurtherShape, Point], FloatArray] = {}
        self.largest_a = max(abs(item.trial.current_a) for item in system.trials)
        #: Whether the rows after the first drop of the current count.
        self.brakes = all(item.trial.held is not None for item in system.trials)
        self.mass_kg = system.constants.mass.value
        self.best, *self.others = _points(found, system)
        self.tests = [test for test in self._offered() if self._motion(test, self.best) is not None]

    def everywhere(self, name: str, test: FurtherShape, most: int) -> FloatArray:
        """Return the widest :meth:`half_widths` (most,) of all friction that the data accept.

        Where they show no Stribeck effect, they accept friction that has none, and so no V_s.
        """
        if name in RISING and self._found.scans["ratio"].low is None:
            return np.full(most, np.inf)
        points = (self.best, *self.others)
        return np.asarray(np.max([self.half_widths(name, test, p, most) for p in points], axis=0))

    def half_widths(self, name: str, test: FurtherShape, point: Point, most: int) -> FloatArray:
        """Return (most,) half widths of a logarithm with the test once, twice, ...

        They are infinite if its slip, or the Stribeck effect, leaves the quantity open.
        """
        theta = point.subject.theta
        rising = name in RISING
        widths = np.full(most, np.inf)
        if (rising and theta[RATIO] <= 0.0) or self.beyond(name, test, point):
            return widths
        gradient = np.zeros(len(point.known))
        gradient[:FRICTION] = _gradient(name, theta) * slopes(PARAMETERS, theta)
        coloured, other = self._doubts(name)
        for k in range(most):
            inverse = scaled_pinv(point.known + (k + 1) * self._information(test, point))
            if rising and theta[RATIO] < EFFECT * coloured * math.sqrt(inverse[RATIO, RATIO]):
                continue
            chance = coloured * math.sqrt(max(float(gradient @ inverse @ gradient), 0.0))
            widths[k] = Z_95 * math.hypot(chance, other)
        return widths

    def beyond(self, name: str, test: FurtherShape, point: Point) -> bool:
        """Whether the slip of the test, with that at hand, does not reach a quantity."""
        found = self._motion(test, point)
        asked = STRIBECK_SPEED.name if name == HEIGHT.name else name
        return found is None or bool(point.subject.beyond(asked, found.visited))

    @property
    def slip_m_s(self) -> tuple[float, float]:
        """The range of slip that all tests reach together."""
        each = [item.visited for test in self.tests if (item := self._motion(test, self.best))]
        return min(low for low, _ in each), max(high for _, high in each)

    def _motion(self, test: FurtherShape, point: Point) -> _Motion | None:
        """Return how a test moves; None if it leaves what the recordings reach."""
        if (test, point) not in self._motions:
            self._motions[test, point] = self._moved(test, point)
        return self._motions[test, point]

    def _moved(self, test: FurtherShape, point: Point) -> _Motion | None:
        low, high = self._found.visited
        if test.shape is None:
            return _Motion(point.subject, None, (low, high))
        subject = _loaded(point.subject, test.load)
        motion = subject.motion(test.shape)
        if refusal(motion, subject.limits):
            return None
        slip = subject.slip(motion)
        low = min(low, subject.visited([motion])[0])
        share = TRIM * (1.0 + self._count / max(len(slip), 1))
        if share < 0.5:
            high = max(high, float(np.quantile(slip, 1.0 - share)))
        return _Motion(subject, motion, (low, high))

    def _information(self, test: FurtherShape, point: Point) -> FloatArray:
        """Return what a test adds, (26, 26), if its recording begins at another angle."""
        if (test, point) not in self._added:
            self._added[test, point] = self._adds(test, point)
        return self._added[test, point]

    def _adds(self, test: FurtherShape, point: Point) -> FloatArray:
        u = np.array([item.u for item in self._system.shared[: len(point.known)]])
        found = self._motion(test, point)
        if found is None:
            return np.zeros_like(point.known)
        if test.shape is None or found.motion is None:
            stated = np.where(np.isfinite(u), 1.0 / u**2, 0.0)
            return _without(point.known - np.diag(stated), OF_THE_ENCODER, u)
        information = found.subject.offered(test.shape, found.motion).information[0]
        by_load = np.ones(len(u))
        by_load[GUIDE] = test.load
        own = OF_THE_ENCODER if test.load == 1.0 else (*OF_THE_ENCODER, MASS)
        return _without(information * np.outer(by_load, by_load), own, u)

    def _doubts(self, name: str) -> tuple[float, float]:
        """Return by how much chance is coloured, and what no test takes away, of a logarithm."""
        found, theta = self._found, self.best.subject.theta
        by_natural = _gradient(name, theta)[None]
        scaled = by_natural[0] * slopes(PARAMETERS, theta)
        block = found.whole.inverse[:FRICTION, :FRICTION]
        by_best = math.sqrt(max(float(scaled @ block @ scaled), 0.0))
        coloured = max(found.chance(by_natural) / by_best, 1.0) if by_best > 0.0 else 1.0
        moved = [_log(name, other[:FRICTION]) - _log(name, theta) for other in found.variants]
        filters = math.sqrt(float(np.mean(np.square(moved)))) if moved else 0.0
        weight = 0.0 if name == STRIBECK_SPEED.name else found.weight_u
        return coloured, math.hypot(filters, found.unexplained(by_natural), weight)

    def _offered(self) -> Iterator[FurtherShape]:
        yield FurtherShape("all of these tests again", None)
        light = f" with a carriage of {LIGHT * self.mass_kg:.3g} kg"

        def amperes(share: float) -> float:
            return round(share * self.largest_a, 2)

        stop = round(_travel(self._system), 2)
        for load, shares, mass in ((1.0, HOLDS, ""), (LIGHT, LIGHT_HOLDS, light)):
            for current in map(amperes, shares):
                words = f"one more test, {current:g} A held{mass}"
                yield FurtherShape(words, Shape(Kind.HOLD.value, current, stop), load)
        first, last = map(amperes, RAMP)
        words = f"one more test, a ramp from {first:g} to {last:g} A in {RAMP_S:g} s"
        yield FurtherShape(words, Shape(Kind.RAMP.value, first, stop, RAMP_S, last))
        if self.brakes:
            most, first, back = self.largest_a, amperes(HOLDS[-1]), amperes(BACK)
            swing = Shape(Kind.SWING.value, most, stop, SWING_S, frequency_hz=SWING_HZ)
            words = f"one more test, swings of ±{most:g} A at {SWING_HZ:g} Hz for {SWING_S:g} s"
            yield FurtherShape(words, swing)
            at = round(TURN * stop, 2)
            turned = Shape(Kind.CHANGE.value, first, stop, BACK_S, back, at)
            words = f"one more test, {first:g} A up to {at:g} m, then {back:g} A for {BACK_S:g} s"
            yield FurtherShape(words, turned)


def _points(found: RigIdentification, system: RigSystem) -> Iterator[Point]:
    """Yield the fit, and the ends of the accepted V_s if the data leave it open."""
    count, sensors = MASS + 1, _sensors(system)
    limits = _limits(system)

    def point(theta: FloatArray, inverse: FloatArray) -> Point:
        subject = Subject("", theta[:count].copy(), sensors, system.constants, limits)
        return Point(subject, scaled_pinv(inverse[:count, :count]))

    yield point(own_parameters(found.whole), found.whole.inverse)
    line = found.scans.get(STRIBECK_SPEED.name)
    if line is None or None not in (line.low, line.high):
        return
    speeds = np.where(line.statistic <= TWO, line.thetas[:, V_S], math.nan)
    for k in {int(np.nanargmin(speeds)), int(np.nanargmax(speeds))}:
        yield point(line.thetas[k], line.inverses[k])


def _sensors(system: RigSystem) -> Sensors:
    row = rows.sensor_rows(system)
    return Sensors(
        row[rows.PERIOD], row[rows.CURRENT_NOISE], row[rows.ANGLE_COUNT], row[rows.POSITION_COUNT],
        row[rows.ACCELERATION_NOISE], row.get(rows.VOLTAGE_AT_REST, math.inf),
        row.get(rows.VOLTAGE_SLOPE, 0.0),
    )  # fmt: skip


def _limits(system: RigSystem) -> Limits:
    """Return the travel of the recordings, with the way that their fastest trial takes to stop."""
    speed = FASTER * rows.sensor_rows(system)[rows.TOP_SPEED]
    low = min(float(np.min(item.measured[:, TRAVEL])) for item in system.trials)
    return Limits(low - AROUND_M, _travel(system) + 0.5 * speed**2 / BRAKE_M_S2 + AROUND_M, speed)


def _travel(system: RigSystem) -> float:
    """Return how far the farthest drive goes, in m."""
    return max(float(np.max(item.measured[:, TRAVEL])) for item in system.trials)


def _loaded(subject: Subject, load: float) -> Subject:
    """Return ``subject`` with a share of the mass: guide and bearings rub in proportion to it."""
    if load == 1.0:
        return subject
    old, shared = subject.constants, subject.shared.copy()
    shared[[MASS, GUIDE]] *= load
    shared[NO_LOAD] += (load - 1.0) * old.bearing_torque.value
    mass, guide, bearing, lift = (
        Known(load * known.value, load * known.u)
        for known in (old.mass, old.guide_friction, old.bearing_torque, old.guide_lift)
    )
    new = replace(old, mass=mass, guide_friction=guide, bearing_torque=bearing, guide_lift=lift)
    return replace(subject, shared=shared, constants=new)


def _without(information: FloatArray, own: Sequence[int], u: FloatArray) -> FloatArray:
    """Return ``information`` (p, p) on the others, if the recording has ``own`` for itself.

    ``u`` (p,) are the stated uncertainties, scaled.
    """
    away = np.array(own)
    kept = np.setdiff1d(np.arange(len(u)), away)
    mixed = information[np.ix_(kept, away)]
    block = information[np.ix_(away, away)] + np.diag(1.0 / u[away] ** 2)
    out = np.zeros_like(information)
    part = information[np.ix_(kept, kept)] - mixed @ np.linalg.solve(block, mixed.T)
    out[np.ix_(kept, kept)] = part
    return out


def _log(name: str, theta: FloatArray) -> float:
    """Return the logarithm of a parameter, or of g at a slip such as ``g@50mm/s``."""
    slip = slip_of(name)
    if slip is None:
        return float(ALL[name].log(theta)[0])
    return math.log(float(friction(theta, np.array([slip]))[0]))


def _gradient(name: str, theta: FloatArray) -> FloatArray:
    """Return the gradient (6,) of :func:`_log`, natural."""
    slip = slip_of(name)
    if slip is None:
        return np.asarray(ALL[name].log_gradient(theta)[0])
    at = np.array([slip])
    return np.asarray(friction_gradient(theta, at)[0] / friction(theta, at)[0])
