"""May numbers be given at all? What the model leaves unexplained, against what noise leaves.

Three outcomes: the model fits; it fits once the data have corrected a constant within reason; or it
does not fit, and then no number of it may be quoted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rigd.analysis.output_error import OutputErrorFit
from rigd.analysis.result import FitOutcome, FloatArray, Gate

CONTRADICTED = 3.0  #: a constant that the data move by more of its uncertainties is contradicted
CORRECTED = 1.5  #: and one that they move by more than this is worth a word
UNEXPLAINED = 1.25  #: rms of the innovations of an output, 1 if model and noise are right
MOST = 4  #: findings that are given; what else is moved follows from these
UNEXPLAINED_TRIAL = 1.5  #: and in the worst trial


def judge_fit(fit: OutputErrorFit, labels: Sequence[str]) -> Gate:
    """Return whether the numbers of ``fit`` may be given; ``labels`` (trials,) name the trials."""
    moved = _moved(fit)
    contradicted = [text for pull, text in moved if abs(pull) > CONTRADICTED]
    corrected = [text for pull, text in moved if CORRECTED < abs(pull) <= CONTRADICTED]
    unexplained = _unexplained(fit, labels)
    if contradicted or unexplained:
        found = (*contradicted, *unexplained, *corrected)[:MOST]
        return Gate(FitOutcome.MISFIT, f"The model does not fit these data: {found[0]}", found)
    if corrected:
        sentence = f"The model fits once the data correct a constant: {corrected[0]}"
        return Gate(FitOutcome.CORRECTED, sentence, tuple(corrected))
    return Gate(FitOutcome.FITS, "The model fits these data within the noise of the sensors.")


def _moved(fit: OutputErrorFit) -> list[tuple[float, str]]:
    """Return each stated constant with its pull and a sentence, the most contradicted first."""
    found = []
    for index, unknown in enumerate(fit.model.system.shared):
        if not math.isfinite(unknown.u) or not unknown.wording:
            continue
        parameter, pull = unknown.parameter, float(fit.pulls[index])
        value, stated = float(fit.fit.theta[index]), parameter.start
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        found.append(
            (
                pull,
                f"{parameter.name} ({unknown.wording}) would have to be {value:.4g}{unit}, stated "
                f"is {stated:.4g}{unit}: {abs(pull):.1f} of its uncertainties away.",
            )
        )
    return sorted(found, key=lambda item: -abs(item[0]))


def _unexplained(fit: OutputErrorFit, labels: Sequence[str]) -> list[str]:
    """Return a sentence on each output whose innovations the noise of the sensors cannot be."""
    white = [
        noise.whiten_errors(error) for noise, error in zip(fit.model.noise, fit.errors, strict=True)
    ]
    found = []
    for index, output in enumerate(fit.model.system.outputs):
        ratios = [_rms(values[:, index]) for values in white]
        together = _rms(np.concatenate([values[:, index] for values in white]))
        worst = int(np.argmax(ratios))
        if together > UNEXPLAINED or ratios[worst] > UNEXPLAINED_TRIAL:
            found.append(
                f"its {output.name} is off by {together:.1f} times what the noise of current and "
                f"sensors leaves, by {ratios[worst]:.1f} times in trial {labels[worst]}."
            )
    return found


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
