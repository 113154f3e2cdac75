"""Holds what output error found: the fit, other filters of the current, profiles, the gate."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from rigd.analysis.extended import own_parameters
from rigd.analysis.identifiability import UNIDENTIFIABLE_LOG_SD
from rigd.analysis.left_out import jackknife_sd
from rigd.analysis.model import slopes
from rigd.analysis.output_error import OutputErrorFit
from rigd.analysis.owed import owed_to_constants
from rigd.analysis.profile import ProfileScan
from rigd.analysis.result import (
    FloatArray,
    Gate,
    Meaning,
    ResidualTest,
)
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
HEIGHT = Quantity(
    "mu_s-mu_c", "μ_s - μ_c", "1", "height of the Stribeck effect", height, height_gradient
)


@dataclass(frozen=True, eq=False)
class Found:
    """The fit, what other filters of the current make of it, and the profiles."""

    whole: OutputErrorFit
    others: tuple[FloatArray, ...]
    scans: dict[str, ProfileScan]
    visited: tuple[float, float]
    gate: Gate
    tests: tuple[ResidualTest, ...] = ()
    weight_u: float = (
        0.0  #: relative standard uncertainty of gravity: friction is force over weight
    )
    #: (6,) or longer, scaled: of what is left unexplained, and of what explains as much
    shifts: tuple[FloatArray, ...] = ()
    without: FloatArray = field(  #: (trials, p), scaled: steps without each trial, if named
        default_factory=lambda: np.zeros((0, FRICTION))
    )

    @property
    def theta(self) -> FloatArray:
        """All fitted parameters in natural units, (p,)."""
        return self.whole.fit.theta

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
        return max(chance, jackknife_sd(self.without[:, :FRICTION] @ gradient[:FRICTION]))

    def weight(self, quantity: Quantity) -> float:
        """Return what gravity adds: all but V_s are forces over the weight."""
        return 0.0 if quantity.name == "V_s" else self.weight_u

    def method(self, quantity: Quantity) -> float:
        """Return what the method leaves open: other filters, and what was not explained.

        Of the filters it is the root mean square change of the logarithm, of what was not
        explained the largest, and of what varies in the recordings how much it does.
        """
        centre = quantity.log(self.theta[:FRICTION])[0]
        moved = [quantity.log(other[:FRICTION])[0] - centre for other in self.others]
        filters = float(np.sqrt(np.mean(np.square(moved)))) if moved else 0.0
        return math.hypot(filters, self.unexplained(quantity.log_gradient(self.theta[:FRICTION])))

    def unexplained(self, by_natural: FloatArray) -> float:
        """Return by how much what is left may move a logarithm with this gradient (1, 6).

        That is too what something else that explains as much would make of it.
        """
        gradient = self._padded(by_natural[0])[:FRICTION]
        moved = (abs(float(gradient @ shift[:FRICTION])) for shift in self.shifts)
        shift = max(moved, default=0.0)
        varies = [item for item in self.gate.explanations if item.meaning is Meaning.VARIES]
        return math.hypot(shift, *(abs(item.size) for item in varies))

    def ridge(self, quantity: Quantity) -> tuple[float, float]:
        """Return how far profiles take the logarithm below and above that of the fit."""
        centre = quantity.log(self.theta[:FRICTION])[0]
        moved = [
            quantity.log(point[:FRICTION])[0] - centre
            for line in self.scans.values()
            for point in line.accepted
        ]
        return max(-min(moved, default=0.0), 0.0), max(*moved, 0.0, 0.0)

    def budget(self, quantity: Quantity) -> dict[str, float]:
        """Return the standard uncertainty of the logarithm by its sources."""
        gradient = self._padded(quantity.log_gradient(self.theta[:FRICTION])[0])
        parts = {name: math.sqrt(share) for name, share in self.whole.budget(gradient).items()}
        parts["filter of the current"] = self.method(quantity)
        return {**parts, "gravity": self.weight(quantity)}

    def owed(self, quantity: Quantity, spread: float) -> str:
        """Return which constant keeps a quantity from being known; empty if none does.

        ``spread`` is the standard deviation of the logarithm that its interval stands for.
        """
        gradient = self._padded(quantity.log_gradient(self.theta[:FRICTION])[0])
        owed = owed_to_constants(
            self.whole, gradient, spread, UNIDENTIFIABLE_LOG_SD, {"gravity": self.weight(quantity)}
        )
        return "" if owed is None else owed.sentence

    def _padded(self, by_natural: FloatArray) -> FloatArray:
        gradient = np.zeros(len(self.theta))
        scale = slopes(self.whole.model.parameters, self.theta)[:FRICTION]
        gradient[:FRICTION] = by_natural * scale
        return gradient


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
