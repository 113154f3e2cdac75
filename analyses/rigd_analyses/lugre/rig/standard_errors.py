"""Makes standard errors and regions of what an identification of the rig shows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from rigd.analysis.estimates import Share
from rigd.analysis.fitting.identifiability import UNIDENTIFIABLE_LOG_SD, Z_95
from rigd.analysis.fitting.model import slopes
from rigd.analysis.fitting.profile import ProfileScan
from rigd.analysis.fitting.uncertainty import delta_sd
from rigd.analysis.output_error.augmented_system import own_parameters
from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.output_error.limiting_constant import owed_to_constants
from rigd.analysis.output_error.pipeline import Family, Identification
from rigd.analysis.result import FloatArray, Meaning
from rigd_analyses.lugre.model import (
    PARAMETERS,
)
from rigd_analyses.lugre.quantities import (
    Quantity,
    height,
    height_gradient,
)
from rigd_analyses.lugre.rig import kernel
from rigd_analyses.lugre.rig.system import (
    RigSystem,
)

WINDOW_S = 0.021  #: least filter of the current
FRICTION = len(PARAMETERS)
UNEXPLAINED = "what varies or is not explained"  #: in a budget
#: Of the load: what its shares are called in a budget.
OF_THE_LOAD = {"gravity": "gravity", "guide_lift": "what the guide bears"}
HEIGHT = Quantity(
    "mu_s-mu_c", "μ_s - μ_c", "1", "height of the Stribeck effect", height, height_gradient
)


@dataclass(frozen=True, eq=False)
class Beside:
    """A point that a profile accepts, for what the data allow around it.

    ``theta`` (6,) natural, ``inverse`` (6, 6) of the information, scaled, with what the profile
    holds held; ``reach`` is how many standard deviations the point leaves until the region of 95 %
    ends.
    """

    theta: FloatArray
    inverse: FloatArray
    reach: float


@dataclass(frozen=True, eq=False)
class RigIdentification(Identification[Family[RigSystem]]):
    """What the trials of the rig show: the fit, other filters of the current, and the profiles.

    ``visited`` is the range of slip in m/s at which the bristle shows g. ``load`` is the doubt in
    the load, as shares of the logarithm of friction over it.
    """

    visited: tuple[float, float] = (0.0, 0.0)
    load: tuple[Share, ...] = ()
    beside: tuple[Beside, ...] = ()

    @property
    def weight_u(self) -> float:
        """Relative standard uncertainty of the load on the wheel."""
        return math.hypot(*(share.effect for share in self.load))

    def error(self, quantity: Quantity) -> float:
        """Return the standard error of the logarithm: noise, constants, filter of the current."""
        by_natural = quantity.log_gradient(self.theta[:FRICTION])
        return math.hypot(self.chance(by_natural), self.method(quantity), self.weight(quantity))

    def chance(self, by_natural: FloatArray) -> float:
        """Return the standard error from noise and constants of a logarithm's gradient (1, 6).

        If something was added to the model, it is no less than what single trials make of it.
        """
        gradient = self._padded(by_natural[0])
        chance = math.sqrt(max(float(gradient @ self.whole.covariance @ gradient), 0.0))
        return max(chance, self.by_trials(gradient[:FRICTION]))

    def by_data(self, quantity: Quantity) -> float:
        """Return the standard error of the logarithm that data and constants alone leave."""
        alone = replace(self, without=self.without[:0])
        return math.hypot(max(alone.ridge(quantity)) / Z_95, self.weight(quantity))

    def weight(self, quantity: Quantity) -> float:
        """Return what the load adds: all but V_s are forces over it."""
        return 0.0 if quantity.name == "V_s" else self.weight_u

    def method(self, quantity: Quantity) -> float:
        """Return what the method leaves open: other filters, what was not explained or is assumed.

        Of the filters it is the root mean square change of the logarithm, of what was not
        explained the largest, and of what varies in the recordings how much it does.
        """
        by_natural = quantity.log_gradient(self.theta[:FRICTION])
        return math.hypot(self.filters(quantity), self.besides(by_natural))

    def filters(self, quantity: Quantity) -> float:
        """Return the root mean square change of the logarithm with other filters of the current."""
        centre = quantity.log(self.theta[:FRICTION])[0]
        return self.by_method(lambda other: float(quantity.log(other[:FRICTION])[0] - centre))

    def unexplained(self, by_natural: FloatArray) -> float:
        """Return by how much what is left may move a logarithm with this gradient (1, 6).

        That is too what something else that explains as much would make of it.
        """
        shift = self.by_unexplained(self._padded(by_natural[0])[:FRICTION])
        varies = [item for item in self.gate.explanations if item.meaning is Meaning.VARIES]
        return math.hypot(shift, *(abs(item.size) for item in varies))

    def besides(self, by_natural: FloatArray) -> float:
        """Return what is left unexplained and what is assumed together; (1, 6) as above."""
        return math.hypot(
            self.unexplained(by_natural), self.by_assumptions(self._padded(by_natural[0]))
        )

    def ridge(self, quantity: Quantity) -> tuple[float, float]:
        """Return how far the logarithm may be below and above that of the fit; :meth:`region`."""
        below, above = self.region(quantity.log, quantity.log_gradient)
        return float(below[0]), float(above[0])

    def region(
        self, log: Callable[[FloatArray], FloatArray], gradient: Callable[[FloatArray], FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Return how far logarithms (m,) may be below and above those of the fit, each (m,).

        ``log`` (m,) and ``gradient`` (m, 6) are functions of the natural parameters. The region is
        that around all points that the profiles accept: if V_s is open, how well the data determine
        another parameter depends on V_s.
        """
        here = self.theta[:FRICTION]
        centre, by_natural = log(here), gradient(here)
        chance = np.array([self.chance(row[None]) for row in by_natural])
        by_best = _spread(by_natural, self._at_best())
        coloured = np.divide(chance, by_best, out=np.ones_like(chance), where=by_best > 0.0)
        below = above = Z_95 * chance
        for point in self.beside:
            moved = log(point.theta) - centre
            reach = point.reach * coloured * _spread(gradient(point.theta), point)
            below, above = np.maximum(below, reach - moved), np.maximum(above, reach + moved)
        return below, above

    def doubt(self, quantity: Quantity) -> float:
        """Return the standard error of the logarithm over that of the curvature alone, 1 or more.

        A profile rises with the curvature: by the square of this it rises too fast. The doubt in
        the load, by which all friction grows alike, is left out. Infinite for a quantity that is 0.
        """
        if quantity.value(self.theta[:FRICTION]) <= 0.0:  # at mu_s = mu_c, on the bound
            return math.inf
        by_natural = quantity.log_gradient(self.theta[:FRICTION])
        chance = self.chance(by_natural)
        by_best = float(_spread(by_natural, self._at_best())[0])
        error = math.hypot(chance, self.method(quantity))
        return max(error / by_best, 1.0) if by_best > 0.0 else 1.0

    def _at_best(self) -> Beside:
        block = self.whole.inverse[:FRICTION, :FRICTION]
        return Beside(self.theta[:FRICTION], block, Z_95)

    def budget(self, quantity: Quantity) -> dict[str, float]:
        """Return the standard uncertainty of the logarithm by its sources."""
        by_natural = quantity.log_gradient(self.theta[:FRICTION])
        shares = self.whole.budget(self._padded(by_natural[0]))
        return {
            **{name: math.sqrt(share) for name, share in shares.items()},
            "filter of the current": self.filters(quantity),
            UNEXPLAINED: self.unexplained(by_natural),
            **{
                share.constant: abs(share.held)
                for share in self.assumed(self._padded(by_natural[0]))
            },
            **self._of_the_load(quantity),
        }

    def shares(self, quantity: Quantity) -> tuple[Share, ...]:
        """Return what stated constants add to the logarithm, each if it is 1 u larger."""
        gradient = self._padded(quantity.log_gradient(self.theta[:FRICTION])[0])
        load = [share for share in self.load if share.effect and quantity.name != "V_s"]
        return (*self.whole.shares(gradient), *self.assumed(gradient), *load)

    def owed(self, quantity: Quantity, spread: float) -> str:
        """Return which constant keeps a quantity from being known; empty if none does.

        ``spread`` is the standard deviation of the logarithm that its interval stands for.
        """
        gradient = self._padded(quantity.log_gradient(self.theta[:FRICTION])[0])
        owed = owed_to_constants(
            self.whole, gradient, spread, UNIDENTIFIABLE_LOG_SD, self._of_the_load(quantity)
        )
        return "" if owed is None else owed.sentence

    def _of_the_load(self, quantity: Quantity) -> dict[str, float]:
        """Return the standard deviations of the logarithm by what the load is made of."""
        if quantity.name == "V_s":
            return dict.fromkeys(OF_THE_LOAD.values(), 0.0)
        found = {OF_THE_LOAD[share.constant]: abs(share.effect) for share in self.load}
        return dict.fromkeys(OF_THE_LOAD.values(), 0.0) | found

    def _padded(self, by_natural: FloatArray) -> FloatArray:
        gradient = np.zeros(len(self.theta))
        scale = slopes(self.whole.model.parameters, self.theta)[:FRICTION]
        gradient[:FRICTION] = by_natural * scale
        return gradient


def beside(scans: Mapping[str, ProfileScan]) -> tuple[Beside, ...]:
    """Return the points that ``scans`` accept, with what each leaves open besides its own value.

    A ratio of mu_s to mu_c that data without a Stribeck effect allow by chance comes with a V_s of
    its own: if the profile of V_s has an open end, the region is that of two parameters (Davies,
    Biometrika 64, 1977: a parameter that exists under one of two hypotheses only).
    """
    speed = scans.get("V_s")
    is_open = speed is not None and None in (speed.low, speed.high)
    threshold = float(chi2.ppf(0.95, 2 if is_open else 1))
    found = []
    for line in scans.values():
        accepted = line.statistic <= max(threshold, line.slack * line.threshold)
        for k in map(int, np.flatnonzero(accepted)):
            reach = math.sqrt(max(threshold - float(line.statistic[k]), 0.0))
            inverse = line.held(k)[:FRICTION, :FRICTION]
            found.append(Beside(line.thetas[k, :FRICTION], inverse, reach))
    return tuple(found)


def _spread(by_natural: FloatArray, point: Beside) -> FloatArray:
    """Return the standard deviations (m,) by the information at ``point``.

    ``by_natural`` (m, 6) are the gradients to the natural parameters there.
    """
    return delta_sd(by_natural * slopes(PARAMETERS, point.theta), point.inverse)


def all_states(system: RigSystem, whole: OutputErrorFit) -> list[FloatArray]:
    """Return the fitted states (n, 6) of each trial; columns as in :mod:`.kernel`."""
    theta, shared = own_parameters(whole), len(system.shared)
    local = theta[shared:].reshape(len(system.trials), -1)
    return [system.states(k, theta[:shared], local[k]) for k in range(len(system.trials))]


def slip(system: RigSystem, whole: OutputErrorFit, states: FloatArray) -> FloatArray:
    """Return the fitted slip V_r (n,) in m/s of one trial."""
    names = [unknown.parameter.name for unknown in system.shared]
    radius = whole.fit.theta[names.index("wheel_radius")]
    return np.asarray(radius * states[:, kernel.WHEEL_SPEED] - states[:, kernel.SPEED])
