"""Holds the numbers of method A to the simulated rig: the same gate stands before both methods.

Method A takes slip and constants as exact. Output error simulates the rig, corrects the constants
within their uncertainties, and tests what is left (:mod:`.rig.family`). If the model does not
fit, method A gives no number either; a number that output error contradicts is not given.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rigd.analysis.output_error.gate import settled_gate
from rigd.analysis.output_error.homogeneity import changes
from rigd.analysis.result import (
    Curve,
    FitOutcome,
    FloatArray,
    IdentificationResult,
    ParameterEstimate,
    Verdict,
)
from rigd_analyses.lugre.model import friction
from rigd_analyses.lugre.quantities import BY_COVARIANCE, PROFILED, TOTAL_DAMPING
from rigd_analyses.lugre.rig.family import RigFit
from rigd_analyses.lugre.rig.standard_errors import FRICTION, HEIGHT

QUANTITIES = {item.name: item for item in (*PROFILED, *BY_COVARIANCE, TOTAL_DAMPING, HEIGHT)}
HINT = "`--method output-error` gives its numbers."


def checked(result: IdentificationResult, begun: RigFit) -> IdentificationResult:
    """Return ``result`` of method A with the gate of ``begun``, a fit of the same trials."""
    gate = settled_gate(begun.gate, begun.whole.unsettled)
    if gate.outcome is FitOutcome.MISFIT:
        return replace(
            result,
            parameters=tuple(_refused(item, gate.sentence) for item in result.parameters),
            derived=(),
            curve=_emptied(result.curve),
            warnings=(gate.sentence, *gate.findings[1:], *result.warnings),
            gate=gate,
            point=None,
        )
    theta = begun.whole.fit.theta[:FRICTION]
    named = list(_named(begun)) if gate.outcome is FitOutcome.CORRECTED else []
    return replace(
        result,
        parameters=tuple(_held(item, theta) for item in result.parameters),
        derived=tuple(_held(item, theta) for item in result.derived),
        curve=_widened(result.curve, theta),
        warnings=(*named, *changes(begun.tests), *result.warnings),
        gate=gate,
    )


def _named(begun: RigFit) -> Iterator[str]:
    yield f"{begun.gate.sentence} Slip-force does not correct for it. {HINT}"
    yield from begun.gate.findings[1:]


def _refused(entry: ParameterEstimate, why: str) -> ParameterEstimate:
    return replace(
        entry, low=None, high=None, standard_error=None, verdict=Verdict.MISFIT, sentence=why,
        flags=(), advice="",
    )  # fmt: skip


def _held(entry: ParameterEstimate, theta: FloatArray) -> ParameterEstimate:
    """Return ``entry``, without a number if output error ends outside of its interval."""
    if not entry.identifiable:
        return entry
    other = QUANTITIES[entry.name].value(theta)
    below = entry.low is not None and other < entry.low
    above = entry.high is not None and other > entry.high
    if not (below or above):
        return entry
    unit = "" if entry.unit == "1" else f" {entry.unit}"
    return replace(
        entry, low=None, high=None, standard_error=None, verdict=Verdict.UNRESOLVED, advice="",
        sentence=f"Output error, which corrects the constants within their uncertainties, ends at "
        f"{other:.4g}{unit}, outside of the interval of this method. {HINT}",
    )  # fmt: skip


def _widened(curve: Curve, theta: FloatArray) -> Curve:
    """Return the band of g, widened to hold that of output error."""
    other = friction(theta, curve.x)
    return replace(curve, low=np.minimum(curve.low, other), high=np.maximum(curve.high, other))


def _emptied(curve: Curve) -> Curve:
    none = np.zeros(0)
    return replace(curve, x=none, y=none, low=none, high=none, seen=())
