"""Tests whether a model that folds both directions of motion holds for both alike.

A model of friction over speed takes force and speed in the direction of motion. A zero of the
sensor, a weight, a tilt or a joint that differs by direction then adds to the force one way and
takes from it the other way: a column of +1 and -1 that the model does not have. The test is a score
test of that one column (Rao, Proc. Camb. Phil. Soc. 44, 1948): with the Jacobian J of the model and
the column d, the amount follows from the part of d that J cannot represent.

The score is a sum over the force as it was recorded, in which a drift keeps its sign from stroke to
stroke. So its variance is that of coloured residuals or, if larger, that of sums over blocks of the
longest correlation that is accounted for anyway, with the autocorrelation of these sums up to a
quarter of the data, and Student's t for as many independent ones as that leaves.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t

from rigd.analysis.fitting.model import Model, slopes
from rigd.analysis.fitting.selection import VERY_STRONG
from rigd.analysis.fitting.trial_errors import LEAST
from rigd.analysis.fitting.uncertainty import autocorrelation_time, scaled_pinv
from rigd.analysis.report.rounding import number, places_for, probability
from rigd.analysis.result import FloatArray, ResidualTest

#: Chance of a false alarm; each of them splits a result in two.
LEVEL: Final = 0.005
NAME: Final = "agreement of directions"
_TINY: Final = float(np.finfo(np.float64).tiny)


class Asymmetry(Enum):
    """What a difference of the directions does over the speeds, as far as the data tell."""

    CONSTANT = (
        "It is the same at all speeds, as that of a zero of the sensor, of a weight or tilt, or of "
        "Coulomb friction that differs; these data cannot tell which. Read the sensor without "
        "contact: if it is its zero, take it off and identify again."
    )
    FRICTION = (
        "It grows and falls with the friction, as that of a joint or contact that differs by "
        "direction; that of a zero of the sensor would be the same at all speeds."
    )
    UNKNOWN = (
        "Whether it is a zero of the sensor, a weight or tilt, or a joint that differs by "
        "direction, these data cannot tell: over these speeds the friction changes too little. "
        "Read the sensor without contact, and play a wider range of speeds."
    )


@dataclass(frozen=True)
class Directions:
    """The friction forward and backward, means over the samples, and what adds to one of them.

    Each is (value, half the interval of 95 %) in the unit of the output; ``amount`` is half the
    difference.
    """

    forward: tuple[float, float]
    backward: tuple[float, float]
    amount: tuple[float, float]
    statistic: float
    p_value: float
    shape: Asymmetry

    @property
    def agree(self) -> bool:
        """Whether chance explains the difference."""
        return self.p_value > LEVEL

    def test(self, name: str, unit: str) -> ResidualTest:
        """Return it as a test of the residuals; ``name`` is that of the output in ``unit``."""
        forward, backward, amount = (
            f"{number(value, places_for(half))} ± {number(half, places_for(half))}"
            + ("" if unit == "1" else f" {unit}")
            for value, half in (self.forward, self.backward, self.amount)
        )
        means = f"{name} forward {forward}, backward {backward} (means over the samples)"
        sentence = (
            f"The directions agree within chance: {means}."
            if self.agree
            else f"The directions differ ({probability(self.p_value)}): {means}; half the "
            f"difference is {amount}. {self.shape.value}"
        )
        return ResidualTest(NAME, self.statistic, self.p_value, self.agree, sentence)


def directions(
    model: Model, theta: FloatArray, direction: FloatArray, output: FloatArray, scale: float,
    block: int,
) -> Directions | None:  # fmt: skip
    """Return how the friction of ``model`` differs by direction; None if all goes one way.

    ``theta`` (p,) is its best fit, ``direction`` (n,) +1 or -1 at each sample, ``output`` (n,) the
    fitted friction; residuals times ``scale`` are in its unit. ``block`` is the longest
    correlation, in samples, that is accounted for anyway.
    """
    used = model.mask > 0.0
    sign = direction[used]
    if np.unique(sign).size < 2:
        return None
    ends = np.cumsum([0, *(np.count_nonzero(used[part]) for part in model.trial_slices)])
    trials = [slice(first, last) for first, last in itertools.pairwise(ends)]
    jacobian = (model.jacobian(theta) * slopes(model.parameters, theta))[used]
    error = model.residuals(theta)[used]
    level = float(np.mean(output[used]))
    constant, by_friction = (
        _Added.of(error, jacobian, column, trials, block)
        for column in (sign, sign * output[used] / level)
    )
    better = min(constant, by_friction, key=lambda item: item.cost)
    gain = better.effective * math.log(constant.cost / by_friction.cost)  # of -2 ln L
    added, shape = constant, Asymmetry.UNKNOWN if gain > -VERY_STRONG else Asymmetry.CONSTANT
    if gain >= VERY_STRONG:
        added, shape = by_friction, Asymmetry.FRICTION
    alone = np.append(np.zeros(len(theta)), 1.0)
    mean = np.append(np.mean(jacobian, axis=0), 0.0)
    half, sd, freedom = added.spread(alone)
    amount = float(added.step[-1])
    centre = level / scale + float(mean @ added.step)
    statistic = amount / max(sd, LEAST)
    return Directions(
        (scale * (centre + amount), scale * added.spread(mean + alone)[0]),
        (scale * (centre - amount), scale * added.spread(mean - alone)[0]),
        (scale * amount, scale * half),
        statistic,
        2.0 * float(t.sf(abs(statistic), freedom)),
        shape,
    )


@dataclass(frozen=True, eq=False)
class _Added:
    """The model with one column more: the step (p + 1,) to its optimum, and what is left (n,)."""

    columns: FloatArray
    inverse: FloatArray
    step: FloatArray
    left: FloatArray
    inflation: float
    blocks: NDArray[np.int64]

    @staticmethod
    def of(
        error: FloatArray, jacobian: FloatArray, column: FloatArray, trials: Sequence[slice],
        block: int,
    ) -> _Added:  # fmt: skip
        """Return it for ``column`` (n,); residuals remember up to ``block`` samples anyway."""
        columns = np.column_stack([jacobian, column])
        inverse = scaled_pinv(columns.T @ columns)
        step = -inverse @ (columns.T @ error)
        left = error + columns @ step
        inflation = autocorrelation_time(left, np.ones(len(left)), trials, block)
        blocks = np.concatenate([np.arange(part.start, part.stop, block) for part in trials])
        return _Added(columns, inverse, step, left, inflation, blocks)

    @property
    def cost(self) -> float:
        """The sum of squares that is left."""
        return max(float(self.left @ self.left), _TINY)

    @property
    def effective(self) -> float:
        """Samples as independent as those left are for the amount of the column."""
        alone = np.append(np.zeros(len(self.step) - 1), 1.0)
        white = self._variance * float(self.inverse[-1, -1])
        return len(self.left) * min(1.0, white / max(self.spread(alone)[1] ** 2, _TINY))

    @property
    def _variance(self) -> float:
        return self.cost / max(len(self.left) - len(self.step), 1)

    def spread(self, contrast: FloatArray) -> tuple[float, float, float]:
        """Return half an interval of 95 % of ``contrast @ theta``, standard error, freedom."""
        weight = self.columns @ (self.inverse @ contrast)
        coloured = math.sqrt(self.inflation * self._variance * float(weight @ weight))
        sums, count = np.add.reduceat(weight * self.left, self.blocks), len(self.blocks)
        whole = [slice(0, count)]
        time = autocorrelation_time(sums, np.ones(count), whole, max(2, count // 4))
        # The step leaves the sums without a mean: that takes a share of each covariance away.
        time *= 1.0 + time / count
        freedom = max(count / time - len(contrast), 1.0)
        by_blocks = math.sqrt(time * count / max(count - len(contrast), 1) * float(sums @ sums))
        sd = max(coloured, by_blocks)
        return float(t.ppf(0.975, freedom)) * sd, sd, freedom
