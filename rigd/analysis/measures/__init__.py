"""Measures without a model: what a procedure reads off each trial, and whether it is right.

:func:`measured` reads recordings, :mod:`rigd.analysis.measures.view` shows the result.
"""

from rigd.analysis.measures.recordings import (
    formulas_behind,
    measured,
    measured_if_any,
    varied,
)
from rigd.analysis.measures.result import (
    Judgement,
    MeasureResult,
    Summary,
    TrialReading,
    outcome_of,
)

__all__ = [
    "Judgement",
    "MeasureResult",
    "Summary",
    "TrialReading",
    "formulas_behind",
    "measured",
    "measured_if_any",
    "outcome_of",
    "varied",
]
