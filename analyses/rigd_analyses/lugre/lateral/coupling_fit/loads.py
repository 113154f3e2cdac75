"""Leaves the friction of the guide in each trial to the data, before any coupling explains it.

The load of the guide over the friction of the rollers falls to zero and rises again, with kinks, at
another friction for each lateral speed: a fit of the rollers has many optima. A fit in which each
trial has a friction of its own has one. Its end says what the data know of these frictions, and the
coupling is then found from them alone (:mod:`.coupling_problem`), whatever its kinks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.fitting.fit import Fit, newton_step
from rigd.analysis.fitting.model import (
    FitParameter,
    NormalEquations,
    Scaling,
    scaled_bounds,
    to_natural,
    to_scaled,
)
from rigd.analysis.fitting.uncertainty import scaled_pinv
from rigd.analysis.output_error.augmented_system import Extended
from rigd.analysis.output_error.estimator import OutputErrorFit, conclude
from rigd.analysis.output_error.innovations import Deviations
from rigd.analysis.output_error.system import Around, System, Unknown
from rigd.analysis.output_error.whitened_residuals import OutputErrorModel
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.lateral.system import LateralSystem
from rigd_analyses.lugre.rig.system import GUIDE, NO_LOAD

REACH = 20.0  #: times the stated friction: how far one may be
BROAD = 1.0  #: times it: the uncertainty of each in the fit, taken away again from what it shows


@dataclass(frozen=True, eq=False)
class FreeLoads(Around):
    """``system`` with a friction of the guide for each trial, the last of its local unknowns.

    The shared unknowns are those along the guide. ``drifts`` (n, 3) of each trial and
    ``bearing_nm`` (trials,) are what a coupling adds besides: 0 if none is known yet.
    """

    system: LateralSystem
    drifts: tuple[FloatArray, ...]
    bearing_nm: FloatArray

    @property
    def shared(self) -> tuple[Unknown, ...]:
        """Return the unknowns along the guide."""
        return self.system.straight

    @property
    def local(self) -> tuple[Unknown, ...]:
        """Return the unknowns of each trial; the last is its friction of the guide."""
        stated = self.system.rig.constants.guide_friction.value
        parameter = FitParameter(
            "guide_friction of a trial", "N", -REACH * stated, REACH * stated, stated,
            Scaling.LINEAR,
        )  # fmt: skip
        return (*self.system.local, Unknown(parameter, BROAD * stated))

    @staticmethod
    def of(system: LateralSystem, coupled: FloatArray | None = None) -> FreeLoads:
        """Return the trials of ``system``, at its shared parameters ``coupled`` (p,) if given."""
        count = len(system.speeds)
        if coupled is None:
            blank = tuple(np.zeros_like(measured) for measured in system.measured)
            return FreeLoads(system, blank, np.zeros(count))
        added = [system.besides(k, coupled) for k in range(count)]
        return FreeLoads(
            system, tuple(drift for drift, _ in added), np.array([torque for _, torque in added])
        )

    def simulate(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the outputs (n, 3) of one trial."""
        rig, at = self.system.rig, self._under(trial, shared, local)
        return rig.simulate(trial, at, local[:-1]) + self.drifts[trial]

    def linearise(
        self, trial: int, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the outputs (n, 3) of one trial and their derivatives (n, 3, p + l)."""
        rig, at = self.system.rig, self._under(trial, shared, local)
        outputs, slopes = rig.linearise(trial, at, local[:-1])
        own = slopes[:, :, GUIDE : GUIDE + 1].copy()
        slopes[:, :, GUIDE] = 0.0
        return outputs + self.drifts[trial], np.concatenate([slopes, own], axis=2)

    def deviations(self, trial: int, shared: FloatArray, local: FloatArray) -> Deviations:
        """Return how noise moves the outputs of one trial."""
        under = self._under(trial, shared, local)
        return self.system.rig.deviations(trial, under, local[:-1], settles=False)

    def _under(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        out = shared.copy()
        out[GUIDE] = local[-1]
        out[NO_LOAD] += self.bearing_nm[trial]
        return out


@dataclass(frozen=True, eq=False)
class Loads:
    """What the data know of the friction of the guide in each trial, whatever the coupling.

    ``forces_n`` (trials,) have the ``covariance`` (trials, trials), all else being free or as
    known. All parameters (p,), scaled, are ``scaled`` at these, and move with them by ``moved``
    (p, trials).
    """

    free: FreeLoads
    model: OutputErrorModel
    forces_n: FloatArray
    covariance: FloatArray
    scaled: FloatArray
    moved: FloatArray

    def of(self, trials: Sequence[int]) -> Loads:
        """Return what is known of the forces of these ``trials``, all others being free."""
        places = list(trials)
        return replace(
            self,
            free=replace(self.free, bearing_nm=self.free.bearing_nm[places]),
            forces_n=self.forces_n[places],
            covariance=self.covariance[np.ix_(places, places)],
            moved=self.moved[:, places],
        )

    def under(self, forces_n: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return all else as it goes with given forces (trials,), natural.

        That is the shared parameters along the guide (s,), what was added to the system (c,), and
        the local parameters of each trial (trials, l).
        """
        parameters, system = self.model.parameters, self.model.system
        low, high = scaled_bounds(parameters)
        scaled = self.scaled + self.moved @ (forces_n - self.forces_n)
        theta = to_natural(parameters, np.clip(scaled, low, high))
        own, shared = len(self.free.shared), len(system.shared)
        local = theta[shared:].reshape(self.model.trials, -1)[:, :-1]
        return theta[:own], theta[own:shared], local


def loads_of(found: OutputErrorFit) -> Loads:
    """Return what ``found``, a fit of :class:`FreeLoads`, knows of its forces by data alone."""
    model, free = found.model, _free(found.model.system)
    places = _places(model)
    known = model.known.rows.T @ model.known.rows
    pull = model.known.rows.T @ model.prior_residuals(found.fit.scaled)
    scores = model.known.scores.copy()
    # The broad uncertainty of the forces kept the fit from running away; the data do not have it.
    broad = model.precision[places]
    known[places, places] -= broad
    scores[places, places] -= broad
    pull[places] -= broad * (found.fit.scaled - model.prior)[places]
    information = found.information + known
    inverse = scaled_pinv(information)
    step = newton_step(
        NormalEquations(found.fit.cost, found.slope + pull, information), model, found.fit
    )
    scaled = found.fit.scaled + step
    covariance = (inverse @ (found.scores + scores) @ inverse)[np.ix_(places, places)]
    moved = inverse[:, places] @ scaled_pinv(inverse[np.ix_(places, places)])
    return Loads(free, model, scaled[places], covariance, scaled, moved)


def loads_at(model: OutputErrorModel, theta: FloatArray, block: int) -> Loads:
    """Return what the data know of the forces close to ``theta`` (p,) of ``model``, without a fit.

    ``model`` is that of a :class:`LateralSystem`, perhaps with something added. ``block`` is the
    longest correlation of the scores that is accounted for, in samples.
    """
    whole = model.system
    system = plain(whole)
    own, shared, count = len(system.shared), len(whole.shared), len(system.rig.shared)
    coupled = theta[:own]
    free = OutputErrorModel(with_free_loads(whole, FreeLoads.of(system, coupled)), model.noise)
    forces = [system.mean_force(k, coupled) for k in range(len(system.speeds))]
    local = np.column_stack([theta[shared:].reshape(len(forces), -1), forces])
    at = np.concatenate([coupled[:count], theta[own:shared], local.ravel()])
    scaled = to_scaled(free.parameters, at)
    count = len(at)
    begun = Fit(at, scaled, at, free.cost(at), 0, 1, True, np.zeros((count, count)))
    return loads_of(conclude(free, begun, block))


def with_free_loads(whole: System, free: FreeLoads) -> System:
    """Return ``whole`` with ``free`` in place of the rig's own system."""
    return replace(whole, system=free) if isinstance(whole, Extended) else free


def plain(whole: System) -> LateralSystem:
    """Return the rig's own system of what is fitted.

    Raises:
        TypeError: it is another one.
    """
    inner = whole.system if isinstance(whole, Extended) else whole
    inner = inner.system if isinstance(inner, FreeLoads) else inner
    if not isinstance(inner, LateralSystem):
        raise TypeError(f"{type(inner).__name__} is no lateral system")
    return inner


def _free(whole: System) -> FreeLoads:
    inner = whole.system if isinstance(whole, Extended) else whole
    if not isinstance(inner, FreeLoads):
        raise TypeError(f"{type(inner).__name__} has no friction of each trial")
    return inner


def _places(model: OutputErrorModel) -> NDArray[np.intp]:
    """Return the places of the forces among the parameters."""
    shared, local = len(model.system.shared), len(model.system.local)
    return shared + local * np.arange(model.trials) + local - 1
