"""Reads the friction parameters of a saved model, with what is known of their uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from rigd.analysis.fitting.identifiability import UNIDENTIFIABLE_LOG_SD
from rigd.analysis.result import FloatArray
from rigd.analysis.validation.saved_models import SavedModel
from rigd_analyses.lugre.model import PARAMETERS

POINT: Final = ("fit", "point")
AGAIN: Final = "identify the recordings again with this version of rigd: rigd identify FILE --json"
#: The parameters as the result names them, with their units.
REPORTED: Final = {
    "V_s": "m/s", "mu_c": "1", "mu_s": "1", "sigma_0": "1/m", "sigma_1": "s/m", "sigma_2": "s/m",
}  # fmt: skip
#: Rounding may leave a variance this much below zero, as a share of the largest one.
ROUNDED: Final = 1e-9


@dataclass(frozen=True, eq=False)
class Friction:
    """``theta`` (6,) as :data:`PARAMETERS`; ``roots`` (6, 6) with covariance = roots roots'.

    The covariance is that of natural values while parameters without a known logarithm are held.
    These are in ``alternatives`` (k, 6), which the identification accepts as well.
    ``visited_m_s`` is the slip that identified it, None if the file does not have it. ``uncertain``
    is false if the file holds no uncertainty.
    """

    theta: FloatArray
    roots: FloatArray
    alternatives: FloatArray
    visited_m_s: tuple[float, float] | None
    uncertain: bool


def friction_of(saved: SavedModel) -> Friction:
    """Return the friction that ``saved`` holds.

    It is the point at which the fit ended. A file without one, such as one typed from a paper,
    gives all six parameters.

    Raises:
        ConfigError: a parameter is missing, impossible or in another unit; or the model did not
            fit its own recordings.
    """
    if not saved.fits:
        raise saved.error(
            "this model did not fit the recordings that it was made from: there is nothing to try",
            ("gate",),
            hint="correct what its report names, and identify again",
        )
    for name, unit in REPORTED.items():
        given = saved.get("parameters", name, "unit")
        if given not in (None, unit):
            raise saved.error(
                f"parameters.{name} is in {given}, must be in {unit}",
                ("parameters", name, "unit"),
                hint="write the value in that unit",
            )
    uncertain = saved.get(*POINT) is not None
    theta = _point(saved) if uncertain else _typed(saved)
    if not uncertain:
        nothing = np.zeros((0, len(theta)))
        return Friction(theta, nothing.T, nothing, _visited(saved), uncertain=False)
    slopes = [[item.slope(float(x))] for item, x in zip(PARAMETERS, theta, strict=True)]
    return Friction(
        theta, _roots(saved) * np.array(slopes), _alternatives(saved), _visited(saved),
        uncertain=True,
    )  # fmt: skip


def _point(saved: SavedModel) -> FloatArray:
    names = tuple(item.name for item in PARAMETERS)
    if saved.texts(*POINT, "names") != names:
        raise saved.error(
            f"fit.point.names must be {', '.join(names)}", (*POINT, "names"), hint=AGAIN
        )
    units = saved.texts(*POINT, "units")
    wanted = tuple(item.unit for item in PARAMETERS)
    if units != wanted:
        raise saved.error(
            f"fit.point.units must be {', '.join(wanted)}", (*POINT, "units"), hint=AGAIN
        )
    theta = saved.numbers(*POINT, "values", shape=(len(names),))
    for k, (item, value) in enumerate(zip(PARAMETERS, theta, strict=True)):
        # A parameter on its bound may lie beyond it by rounding.
        if not item.low * (1.0 - ROUNDED) <= value <= item.high * (1.0 + ROUNDED):
            unit = "" if item.unit == "1" else f" {item.unit}"
            raise saved.error(
                f"{item.name} is {value:g}{unit}, must be from {item.low:g} to {item.high:g}{unit}",
                (*POINT, "values", k),
                hint=AGAIN,
            )
    return theta


def _typed(saved: SavedModel) -> FloatArray:
    """Return the point of a file that gives all six parameters.

    Raises:
        ConfigError: one is missing or impossible.
    """
    values = {}
    for name, unit in REPORTED.items():
        keys = ("parameters", name, "estimate")
        if saved.get(*keys) is None:
            raise saved.error(
                f"the model has no value of {name}", ("parameters", name),
                hint=f"a parameter that is not identifiable has none: {AGAIN}",
            )  # fmt: skip
        value = values[name] = saved.number(*keys)
        if not (math.isfinite(value) and value > 0.0):
            shown = "" if unit == "1" else f" {unit}"
            raise saved.error(f"{name} is {value:g}{shown}, must be above 0{shown}", keys)
    if values["mu_s"] < values["mu_c"]:
        raise saved.error(
            f"mu_s is {values['mu_s']:g}, must not be below mu_c, which is {values['mu_c']:g}",
            ("parameters", "mu_s", "estimate"),
        )
    ratio = math.log(values["mu_s"] / values["mu_c"])
    return np.array(
        [values["V_s"], values["mu_c"], ratio, *(values[f"sigma_{k}"] for k in range(3))]
    )


def _roots(saved: SavedModel) -> FloatArray:
    """Return (6, 6) whose product with its transpose is the covariance in scaled coordinates.

    A parameter of which the data leave a factor of two or more lies on a curved ridge, along which
    a covariance has no meaning: it is held (the conditional covariance of the others is taken).
    """
    keys = (*POINT, "covariance")
    count = len(PARAMETERS)
    covariance = saved.numbers(*keys, shape=(count, count))
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    largest = float(np.max(np.abs(covariance)))
    if not np.allclose(covariance, covariance.T, atol=ROUNDED * largest) or np.min(
        values
    ) < -ROUNDED * max(largest, 1.0):
        raise saved.error("fit.point.covariance is no covariance", keys, hint=AGAIN)
    loose = np.sqrt(np.diag(covariance)) > UNIDENTIFIABLE_LOG_SD
    mixed, own = covariance[:, loose], covariance[np.ix_(loose, loose)]
    values, vectors = np.linalg.eigh(covariance - mixed @ np.linalg.pinv(own) @ mixed.T)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _alternatives(saved: SavedModel) -> FloatArray:
    given = saved.get(*POINT, "alternatives")
    count = len(given) if isinstance(given, list) else 0
    if count == 0:
        return np.zeros((0, len(PARAMETERS)))
    return saved.numbers(*POINT, "alternatives", shape=(count, len(PARAMETERS)))


def _visited(saved: SavedModel) -> tuple[float, float] | None:
    curve = saved.get("friction_curve")
    if not isinstance(curve, list) or not curve:
        return None
    ends = (
        saved.number("friction_curve", 0, "V_r"),
        saved.number("friction_curve", len(curve) - 1, "V_r"),
    )
    return ends if ends[0] <= ends[1] else None
