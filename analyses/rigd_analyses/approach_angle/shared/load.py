"""Finds a missed tare, or a wrong span, from what the scale shows of the announced loads.

Each setting of the bolts (one set under one load) gives one point y = shown - announced, with what
is shown as the calibration corrects it: a wrong calibration of the scale shows as well. Bolts
scatter from setting to setting by a share s of the load, which the points show; a part of that,
and of the scale's zero, is the same in all of them. With x the announced load:

    V = diag(s^2 x^2) + u_span^2 x x' + u_zero^2 1 1'

A missed tare is the same at any load (c = 1), a wrong span in proportion to it (c = x); each has
the generalised least-squares estimate (c' V^-1 y)/(c' V^-1 c).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from rigd_analyses.approach_angle.raw.run_data import FloatArray, KnownRun
from rigd_analyses.approach_angle.run_result import RunResult
from rigd_analyses.approach_angle.shared_error import AS_GOOD, SIGNIFICANT, SharedError

#: Fewer settings show neither.
MIN_SETTINGS: Final = 3
#: What bolts scatter by, relative, and how many settings that knowledge is worth: assumed.
SETTING_U: Final = 0.01
SETTING_FREEDOM: Final = 10
#: What all settings of the bolts have in common, relative, and the zero of a scale that was tared.
SPAN_U: Final = 0.003
ZERO_U_KG: Final = 0.01


def load_errors(known: Sequence[KnownRun], results: Sequence[RunResult]) -> list[SharedError]:
    """Return a missed tare or a wrong span, whichever explains the loads better; none if none."""
    shown_kg: dict[tuple[str, float], list[float]] = {}
    names, normals = [], []
    for k, result in zip(known, results, strict=True):
        run = k.run
        if result.excluded or not math.isfinite(run.load_n):
            continue
        mass = k.calibration.load.value * run.load_n / k.rig.gravity
        shown_kg.setdefault((run.set_name, run.announced_load_kg), []).append(mass)
        names.append(run.set_name)
        normals.append(mass)
    if len(shown_kg) < MIN_SETTINGS:
        return []
    announced = np.array([load for _, load in shown_kg])
    shown = np.array([float(np.mean(masses)) for masses in shown_kg.values()])
    off = shown - announced
    covariance = (
        np.diag((_scatter(announced, shown) * announced) ** 2)
        + SPAN_U**2 * np.outer(announced, announced)
        + ZERO_U_KG**2
    )
    tare, span = (_estimate(off, c, covariance) for c in (np.ones_like(announced), announced))
    z_tare, z_span = (abs(size) / u for size, u in (tare, span))
    if max(z_tare, z_span) < SIGNIFICANT:
        return []
    either = abs(z_tare**2 - z_span**2) < AS_GOOD
    by_tare, by_span = abs(tare[0]) / np.array(normals), np.full(len(normals), abs(span[0]))
    relative = np.maximum(by_tare, by_span) if either else by_tare if z_tare > z_span else by_span
    effect = {
        name: float(np.mean(relative[[n == name for n in names]])) for name in dict.fromkeys(names)
    }
    told = _sentence(tare, span, either=either, tared=z_tare > z_span)
    if z_tare > z_span:
        return [SharedError("missed_tare", told, *tare, "kg", effect)]
    return [SharedError("load_span", told, *span, "1", effect)]


def _sentence(
    tare: tuple[float, float], span: tuple[float, float], *, either: bool, tared: bool
) -> str:
    as_tare = (
        f"{1e3 * tare[0]:+.0f} g (± {2e3 * tare[1]:.0f} g) at any load: it was not tared, or "
        "something lies on it"
    )
    as_span = (
        f"{span[0]:+.1%} (± {2 * span[1]:.1%}) of the load: its span, its calibration or the "
        "announced loads are wrong"
    )
    first, second = (as_tare, as_span) if tared else (as_span, as_tare)
    also = f". As well possible: by {second}" if either else ""
    return (
        f"Over all loads the scale differs from what was announced by {first}{also}. The "
        "intervals are widened for it."
    )


def _estimate(off: FloatArray, shape: FloatArray, covariance: FloatArray) -> tuple[float, float]:
    weighted = np.linalg.solve(covariance, shape)
    information = float(shape @ weighted)
    return float(off @ weighted) / information, information**-0.5


def _scatter(announced: FloatArray, shown: FloatArray) -> float:
    """Return the relative scatter of a setting about the straight line through all."""
    freedom = len(announced) - (2 if np.unique(announced).size > 1 else 1)
    weights = 1.0 / announced
    columns = (
        [weights * announced] if freedom == len(announced) - 1 else [weights, np.ones_like(weights)]
    )
    basis, target = np.column_stack(columns), weights * shown
    left = target - basis @ np.linalg.lstsq(basis, target, rcond=None)[0]
    squares = float(left @ left) + SETTING_FREEDOM * SETTING_U**2
    return math.sqrt(squares / (freedom + SETTING_FREEDOM))
