"""Least squares and intervals of mujoco.sysid on the simulated rig: a peer of output error.

What a person gets from ``mujoco.sysid`` 4.0.0 (``pip install 'mujoco[sysid]'``) whose residual is
the difference between this rig, simulated, and its recording. The optimiser with its finite
differences (``optimize``), the weights (``normalize_residual``: each output over its own size) and
the intervals (``calculate_intervals``: s^2 (J'J)^-1 with Student's t) are those of mujoco.sysid,
with its defaults. Only the simulation is not MuJoCo's, which has no LuGre friction: ``optimize``
takes any residual. Parameters, start and what counts as a number are those of
:mod:`identify_plain`.
"""

from __future__ import annotations

import io
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from identify_plain import COUNT, FloatArray, inside, simulated

from rigd_analyses.lugre.model import PARAMETERS
from rigd_analyses.lugre.rig.system import RigSystem

MOST = 60  #: iterations


def is_installed() -> bool:
    """Return whether mujoco.sysid is there with all that it needs; without, it is an empty name."""
    return find_spec("mujoco") is not None and hasattr(import_module("mujoco.sysid"), "optimize")


def fitted(system: RigSystem, begin: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the end of the fit (6,) and its covariance (6, 6), scaled."""
    sysid = import_module("mujoco.sysid")
    point, low, high = inside(begin)
    parameters = sysid.ParameterDict()
    for item, value, least, most in zip(PARAMETERS, point, low, high, strict=True):
        parameters.add(sysid.Parameter(item.name, value, least, most))

    def residual(scaled: FloatArray, _: Any) -> tuple[list[FloatArray], None, None]:
        """Return the residuals of each trial, (n m,) or (n m, c) of ``scaled`` (6,) or (6, c)."""
        columns = scaled.reshape(COUNT, -1).T
        predicted = [simulated(system, column) for column in columns]
        found = []
        for trial, seen in enumerate(system.measured):
            parts = [
                sysid.normalize_residual(sysid.weighted_diff(each[trial], seen), seen).ravel()
                for each in predicted
            ]
            found.append(parts[0] if scaled.ndim == 1 else np.stack(parts, axis=1))
        return found, None, None

    # Its iterations cannot be silenced, but sent elsewhere.
    _, end = sysid.optimize(
        parameters, residual, verbose=False, max_iters=MOST, output=io.StringIO()
    )
    scaled = np.asarray(end.x, dtype=np.float64).ravel()
    covariance, _ = sysid.calculate_intervals(residual(scaled, None)[0], np.asarray(end.jac))
    return scaled, np.asarray(covariance, dtype=np.float64)
