"""Fits single constants of a recording, with fixed friction, and tests the residuals that are left.

The drive's gain and the zero of the current are fitted to the speeds alone, not to the slip,
because the slip is what distinguishes floors. The steps are those of Gauss and Newton, with the
sensitivities of the recursion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.validation.friction import Friction
from rigd_analyses.lugre.validation.motion import (
    COLUMN,
    FRICTION,
    GAIN,
    LATE,
    SLIP,
    SPEED,
    ZERO,
    DrivenMotion,
    Simulated,
    late,
    noise,
    rms,
    simulate,
    stated,
    uncertainties,
)

STEPS: Final = 4
ENOUGH: Final = 1e-4  #: relative to the step before
BLOCK_S: Final = 0.15  #: longest correlation of residuals that an uncertainty allows for
COVERAGE: Final = 3.0  #: of noise and of the model's uncertainty, in a limit
DRIVE: Final = (GAIN, ZERO)
#: Constants that slip alone can show; the speeds show all others.
BY_SLIP: Final = ("wheel_radius", LATE)


@dataclass(frozen=True, eq=False)
class Attempt:
    """All trials with the constants ``names`` fitted; ``values`` (k,) are what is added to them.

    Of the drive's gain it is added to its logarithm. ``errors`` (k,) are standard errors of the
    noise alone, ``by_constants`` (k,) what the stated uncertainties of the others add. ``limits``
    are, for each trial, the most that speed and slip may be off.
    """

    names: tuple[str, ...]
    values: FloatArray
    errors: FloatArray
    by_constants: FloatArray
    simulated: tuple[Simulated, ...]
    limits: tuple[dict[str, float], ...]

    def value(self, name: str) -> float:
        """Return what is added to ``name``, 0 if it is not fitted."""
        return float(self.values[self.names.index(name)]) if name in self.names else 0.0

    def error(self, name: str) -> float:
        """Return the standard error of :meth:`value` by the noise alone."""
        return float(self.errors[self.names.index(name)])

    def doubt(self, name: str) -> float:
        """Return what the stated uncertainties of the other constants leave of :meth:`value`."""
        return float(self.by_constants[self.names.index(name)])

    @property
    def excess(self) -> float:
        """The largest error over its limit."""
        return max(
            rms(item.error(output)) / limit[output]
            for item, limit in zip(self.simulated, self.limits, strict=True)
            for output in (SPEED, SLIP)
        )

    @property
    def passes(self) -> bool:
        """Whether noise and uncertainties explain all errors of speed and slip."""
        return self.excess <= 1.0


def attempt(
    motions: Sequence[DrivenMotion],
    friction: Friction,
    names: tuple[str, ...],
    doubts: Sequence[dict[str, float]],
    reach: Mapping[str, float],
) -> Attempt:
    """Return the trials with the constants ``names`` fitted, the drive's before the others.

    ``doubts`` are those of :func:`model_doubts`; ``reach`` is the most that each constant may move.
    """
    values = np.zeros(len(names))
    most = np.array([reach[name] for name in names])
    drive = [k for k, name in enumerate(names) if name not in BY_SLIP]
    others = [k for k, name in enumerate(names) if name in BY_SLIP]
    simulated = _simulated(motions, friction, names, values)
    for _ in range(STEPS if names else 0):
        before = values.copy()
        for chosen, output in ((drive, SPEED), (others, SLIP)):
            if chosen:
                slopes, error = _stacked(simulated, [names[k] for k in chosen], output)
                values[chosen] -= np.linalg.lstsq(slopes, error, rcond=None)[0]
                values = np.clip(values, -most, most)
                simulated = _simulated(motions, friction, names, values)
        if np.all(np.abs(values - before) <= ENOUGH * np.abs(values)):
            break
    errors, by_constants = np.zeros(len(names)), np.zeros(len(names))
    for chosen, output in ((drive, SPEED), (others, SLIP)):
        if chosen:
            fitted = [names[k] for k in chosen]
            errors[chosen] = _standard_errors(simulated, fitted, output)
            by_constants[chosen] = _taken_up(simulated, fitted, output)
    limits = _limits(simulated, friction, doubts)
    return Attempt(names, values, errors, by_constants, simulated, limits)


def model_doubts(
    motions: Sequence[DrivenMotion], friction: Friction
) -> tuple[dict[str, float], ...]:
    """Return how far the friction that the identification accepts as well moves each trial.

    Half the largest root mean square change: these friction parameters lie at the ends of 95 %
    intervals.
    """
    found = []
    for motion in motions:
        base = simulate(motion, stated(motion, friction.theta), sensitive=False)
        others = [
            simulate(motion, stated(motion, theta), sensitive=False)
            for theta in friction.alternatives
        ]
        found.append(
            {
                output: 0.5
                * max(
                    (rms(other.modelled(output) - base.modelled(output)) for other in others),
                    default=0.0,
                )
                for output in (SPEED, SLIP)
            }
        )
    return tuple(found)


def predicted_excess(start: Attempt, name: str) -> float:
    """Return about what ``excess`` another attempt has that fits ``name`` too.

    From the slopes at ``start``, without simulating again.
    """
    outputs = (SLIP,) if name in BY_SLIP else (SPEED, SLIP)
    names = [name] if name in BY_SLIP else [*start.names, name]
    slopes, error = _stacked(start.simulated, names, outputs[0])
    move = -np.linalg.lstsq(slopes, error, rcond=None)[0]
    return max(
        rms(
            item.error(output)
            + np.stack([item.slopes(output, name) for name in names], axis=1) @ move
        )
        / limit[output]
        for item, limit in zip(start.simulated, start.limits, strict=True)
        for output in outputs
    )


def _simulated(
    motions: Sequence[DrivenMotion], friction: Friction, names: Sequence[str], values: FloatArray
) -> tuple[Simulated, ...]:
    found = []
    for motion in motions:
        q = stated(motion, friction.theta)
        seconds = 0.0
        for name, value in zip(names, values, strict=True):
            if name == LATE:
                seconds = float(value)
            elif name == GAIN:
                q[COLUMN[name]] *= np.exp(value)
            else:
                q[COLUMN[name]] += value
        found.append(late(simulate(motion, q), seconds))
    return tuple(found)


def _stacked(
    simulated: Sequence[Simulated], names: Sequence[str], output: str
) -> tuple[FloatArray, FloatArray]:
    """Return the slopes (n, k) and errors (n,) of all trials, one after the other."""
    slopes = [np.stack([item.slopes(output, name) for name in names], axis=1) for item in simulated]
    return np.concatenate(slopes), np.concatenate([item.error(output) for item in simulated])


def _standard_errors(
    simulated: Sequence[Simulated], names: Sequence[str], output: str
) -> FloatArray:
    """Return standard errors (k,) that hold for correlated residuals: sums over blocks (HAC)."""
    slopes, _ = _stacked(simulated, names, output)
    inverse = np.linalg.pinv(slopes.T @ slopes)
    scores = []
    for item in simulated:
        block = max(1, round(BLOCK_S / item.motion.period_s))
        own = np.stack([item.slopes(output, name) for name in names], axis=1)
        products = own * item.error(output)[:, None]
        scores.append(np.add.reduceat(products, np.arange(0, len(products), block), axis=0))
    blocks = np.concatenate(scores)
    return np.asarray(np.sqrt(np.diag(inverse @ (blocks.T @ blocks) @ inverse)))


def _taken_up(simulated: Sequence[Simulated], names: Sequence[str], output: str) -> FloatArray:
    """Return how far the stated uncertainties of the other constants move ``names``, (k,)."""
    known = [name for name in uncertainties(simulated[0].motion) if name not in names]
    slopes, _ = _stacked(simulated, names, output)
    unknown = np.concatenate([_known_slopes(item, known, output) for item in simulated])
    moved = np.linalg.lstsq(slopes, unknown, rcond=None)[0]
    return np.asarray(np.sqrt(np.sum(moved**2, axis=1)))


def _limits(
    simulated: Sequence[Simulated], friction: Friction, doubts: Sequence[dict[str, float]]
) -> tuple[dict[str, float], ...]:
    """Return the largest permitted deviation of each trial, by output.

    L^2 = 3^2 (noise^2 + model^2) + constants^2: noise as the recording shows it, the model's own
    uncertainty, and the stated standard uncertainties of the constants, less what a fit of the
    drive's gain and zero to the speeds takes up. A constant that is off by more is worth a word,
    and is sought.
    """
    drive, _ = _stacked(simulated, DRIVE, SPEED)
    names = list(uncertainties(simulated[0].motion))
    unknown = np.concatenate([_known_slopes(item, names, SPEED) for item in simulated])
    taken_up = np.linalg.lstsq(drive, unknown, rcond=None)[0]
    found = []
    for item, doubt in zip(simulated, doubts, strict=True):
        limit = {}
        for output in (SPEED, SLIP):
            own = np.stack([item.slopes(output, name) for name in DRIVE], axis=1)
            left = _known_slopes(item, names, output) - own @ taken_up
            by_friction = item.by_q[output][:, :FRICTION] @ friction.roots
            constants = float(np.mean(np.sum(left**2, axis=1)))
            model = float(np.mean(np.sum(by_friction**2, axis=1))) + doubt[output] ** 2
            chance = COVERAGE**2 * (noise(item, output) ** 2 + model)
            limit[output] = float(np.sqrt(chance + constants))
        found.append(limit)
    return tuple(found)


def _known_slopes(item: Simulated, names: Sequence[str], output: str) -> FloatArray:
    """Return what one standard uncertainty of each constant changes, (n, k)."""
    sizes = uncertainties(item.motion)
    return np.stack([sizes[name] * item.slopes(output, name) for name in names], axis=1)
