"""A system with something more in it, or with constants that only the data determine.

Each added value moves the outputs in proportion, by columns that are taken at a fitted motion: so
one thing that the model lacks is fitted with all the rest before there is a model of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigd.analysis.fitting.model import Scaling, to_scaled
from rigd.analysis.output_error.estimator import OutputErrorFit, conclude
from rigd.analysis.output_error.innovations import Deviations
from rigd.analysis.output_error.score import Columns
from rigd.analysis.output_error.system import Around, System, Unknown
from rigd.analysis.output_error.whitened_residuals import OutputErrorModel
from rigd.analysis.result import FloatArray

FAR = 1e3  #: uncertainties or standard errors that bound what only the data determine


@dataclass(frozen=True, eq=False)
class Extended(Around):
    """``system`` with more shared unknowns behind its own; itself a :class:`System`.

    ``columns`` (n, m, c) of each trial are the changes of its outputs for each unit of ``added``
    (c,). ``released`` are the places of shared unknowns that lose what is stated of them.
    """

    added: tuple[Unknown, ...]
    columns: Columns
    released: frozenset[int] = frozenset()

    @property
    def own(self) -> int:
        """Return how many shared unknowns the system has itself."""
        return len(self.system.shared)

    @property
    def shared(self) -> tuple[Unknown, ...]:
        """Return the unknowns of the system, then those that are added."""
        kept = (
            _free(item) if index in self.released else item
            for index, item in enumerate(self.system.shared)
        )
        return (*kept, *self.added)

    def simulate(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the outputs (n, m) of one trial."""
        moved = self.columns[trial] @ shared[self.own :]
        return np.asarray(self.system.simulate(trial, shared[: self.own], local) + moved)

    def linearise(
        self, trial: int, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the outputs (n, m) of one trial and their derivatives (n, m, p + c + l)."""
        own = self.own
        outputs, slopes = self.system.linearise(trial, shared[:own], local)
        more = self.columns[trial]
        whole = np.concatenate([slopes[:, :, :own], more, slopes[:, :, own:]], axis=2)
        return outputs + more @ shared[own:], whole

    def deviations(self, trial: int, shared: FloatArray, local: FloatArray) -> Deviations:
        """Return how noise moves the outputs of one trial."""
        return self.system.deviations(trial, shared[: self.own], local)

    def theta_of_system(self, theta: FloatArray) -> FloatArray:
        """Return the parameters of the system itself, of all of this one's (p + c + l,)."""
        return np.delete(theta, np.arange(self.own, self.own + len(self.added)))


def _free(stated: Unknown) -> Unknown:
    """Return a constant of which nothing is stated."""
    parameter, reach = stated.parameter, FAR * stated.u
    if parameter.scaling is Scaling.LINEAR:
        low = min(parameter.low, parameter.start - reach)
        high = max(parameter.high, parameter.start + reach)
        parameter = replace(parameter, low=low, high=high)
    return Unknown(parameter, wording=stated.wording)


def own_parameters(found: OutputErrorFit) -> FloatArray:
    """Return the parameters (p,) of the rig's own system, of all that were fitted."""
    system, theta = found.model.system, found.fit.theta
    return system.theta_of_system(theta) if isinstance(system, Extended) else theta


def without_added(found: OutputErrorFit, block: int) -> OutputErrorFit:
    """Return the rig's own system at the parameters of ``found``, without what was added to it.

    Its residuals hold what was added. ``block`` is the longest correlation of the scores that is
    accounted for, in samples.
    """
    system = found.model.system
    if not isinstance(system, Extended):
        return found
    model = OutputErrorModel(system.system, found.model.noise)
    theta = own_parameters(found)
    scaled = to_scaled(model.parameters, theta)
    return conclude(model, replace(found.fit, theta=theta, scaled=scaled), block)


def same_with(found: OutputErrorFit, system: System) -> System:
    """Return the system of ``found`` with ``system`` in place of the rig's own."""
    fitted = found.model.system
    return replace(fitted, system=system) if isinstance(fitted, Extended) else system


def moved_constants(stated: Sequence[Unknown], found: OutputErrorFit) -> tuple[str, ...]:
    """Return a sentence on each constant of ``stated``: its fitted value, and how far it moved.

    ``stated`` are the unknowns of the rig's own system. A constant that explains a misfit is left
    to the data in ``found``.
    """
    sentences = []
    for unknown, fitted, value in zip(
        stated, found.model.system.shared, found.fit.theta, strict=False
    ):
        if math.isfinite(unknown.u):
            parameter = unknown.parameter
            left = "" if math.isfinite(fitted.u) else "; left to the data"
            sentences.append(
                f"{parameter.name} ({unknown.wording}): stated {parameter.start:.5g} "
                f"{parameter.unit} with u = {_uncertainty(unknown)}, fitted {value:.5g}, moved by "
                f"{unknown.pull(float(value)):+.2f} of its uncertainty{left}"
            )
    return tuple(sentences)


def _uncertainty(unknown: Unknown) -> str:
    """Return the standard uncertainty of a constant: of a positive one as a share of it."""
    if unknown.parameter.scaling is Scaling.LINEAR:
        return f"{unknown.u:.3g} {unknown.parameter.unit}"
    return f"{100.0 * unknown.u:.3g} %"
