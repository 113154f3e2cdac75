"""Computes the LuGre parameters of each group of trials; adds the published curve to compare."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from rigd.analysis import Options
from rigd.analysis.parameters import (
    Fitted,
    Group,
    ParameterEvaluation,
    complete_groups,
    each_group,
)
from rigd.analysis.recordings.source import RecordedSweep
from rigd.analysis.report import ReferenceCurve
from rigd.analysis.result import IdentificationResult
from rigd_analyses.lugre.joint_floors import check_joint, identify_together, masses
from rigd_analyses.lugre.reading import first_fit, identify


def evaluate(
    sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
) -> ParameterEvaluation:
    """Return the LuGre parameters of each group of trials.

    Raises:
        DataError: a recording has no complete trial, or the data of no group can answer.
    """
    if options.joint:
        return _evaluate_together(sweeps, options, notify)
    found, refused = each_group(
        complete_groups(sweeps, options, notify),
        lambda group: identify(group.trials, options),
        options.processes,
    )
    fitted = [_fitted(group, result) for group, result in found]
    return ParameterEvaluation.of(sweeps, fitted, options, refused=refused)


def _evaluate_together(
    sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
) -> ParameterEvaluation:
    """Return the parameters of all groups in one fit; those of several masses are one group."""
    check_joint(sweeps, options)
    groups = complete_groups(sweeps, options, notify, masses(sweeps))
    begun, refused = each_group(
        groups, lambda group: first_fit(group.trials, options), options.processes
    )
    found, silent, account = identify_together(
        [group for group, _ in begun], [first for _, first in begun], options
    )
    fitted = [_fitted(group, result) for group, result in found]
    return ParameterEvaluation.of(sweeps, fitted, options, account, [*refused, *silent])


def _fitted(group: Group, result: IdentificationResult) -> Fitted:
    curve = reference_curve(group.reference_label, group.reference, result)
    return Fitted(group, result, curve)


def reference_curve(
    label: str, values: Mapping[str, float], result: IdentificationResult
) -> ReferenceCurve | None:
    """Return g(V_r) of the reference values over the range the result visited (corrected Eq. 6).

    None: values are missing, or the result draws another curve than g.
    """
    if not {"V_s", "mu_c", "mu_s"} <= values.keys() or result.curve.y_name != "g":
        return None
    slip = result.curve.x
    decay = np.exp(-np.sqrt(np.abs(slip) / values["V_s"]))
    return ReferenceCurve(label, slip, values["mu_c"] + (values["mu_s"] - values["mu_c"]) * decay)
