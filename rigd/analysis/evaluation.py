"""Evaluates recordings by their analysis; the result has a report, JSON and a terminal table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from rigd.analysis.analysis import Analysis, Evaluation, Options
from rigd.analysis.plan import analysis_of
from rigd.analysis.recordings.corrections import Corrections, corrected
from rigd.analysis.recordings.duplicates import refuse_copies, refuse_same_file
from rigd.analysis.recordings.source import Correction, RecordedSweep, open_sweep
from rigd.model.errors import ConfigError, DataError
from rigd.sdk.analysis import OptionName

#: Why an analysis that does not take an option refuses it, and what to do.
_REFUSED: Final[dict[OptionName, tuple[str, str]]] = {
    "starts": ("--starts: model {} is not fitted from starts", "leave it out"),
    "seed": ("--seed: model {} is not fitted from random starts", "leave it out"),
    "robust": ("--robust: model {} has no robust loss", "leave it out"),
    "calibration": (
        "--calibration: model {} is identified from converted values",
        "leave it out; docs/recordings.md shows how to replay raw counts",
    ),
    "method": ("--method: model {} has one method", "leave it out"),
    "law": ("--law: model {} fits no friction law of choice", "leave it out"),
    "joint": ("--joint: model {} shares no constants between groups", "leave it out"),
    "model": ("--model: model {} takes no parameters of another model", "leave it out"),
    "compare": ("--compare: model {} fits no friction laws to compare", "leave it out"),
    "by_recording": (
        "--group-by recording: model {} evaluates all recordings as one",
        "identify each recording with a command of its own",
    ),
}


def evaluate(
    paths: Sequence[Path],
    options: Options | None = None,
    *,
    notify: Callable[[str], None] = lambda _: None,
    passed_over: Callable[[str], None] = lambda _: None,
    corrections: Corrections | None = None,
    changed: Callable[[Correction], None] = lambda _: None,
) -> Evaluation:
    """Identify what ``paths`` hold; trials of one group may stand in several recordings.

    ``notify`` gets a line before each step that takes long, ``passed_over`` one for all that is
    damaged or lost in a recording. ``corrections`` hold instead of what the recordings carry;
    ``changed`` gets each difference that they make.

    Raises:
        RecordingError: a file cannot be read.
        ConfigError: an option does not fit the analysis, or a calibration or correction is wrong.
        DataError: a file holds nothing to identify, is there twice or beside a copy of itself, or
            the data cannot answer.
    """
    sweeps = open_sweeps(paths, passed_over, corrections, changed)
    return evaluate_sweeps(analysis_of(sweeps[0].plan), sweeps, options or Options(), notify)


def open_sweeps(
    paths: Sequence[Path],
    passed_over: Callable[[str], None],
    corrections: Corrections | None,
    changed: Callable[[Correction], None],
) -> list[RecordedSweep]:
    """Return the recordings at ``paths``, all of one model, corrected; see :func:`evaluate`.

    The procedure of ``corrections`` also states what to do with a recording that has no plan.

    Raises:
        RecordingError: a file cannot be read.
        ConfigError: a correction is wrong.
        DataError: a file has no plan to identify, or is there twice or beside a copy of itself.
    """
    refuse_same_file(paths)
    otherwise = None if corrections is None else corrections.plan
    sweeps = [open_sweep(path, otherwise) for path in paths]
    for loss in (text for sweep in sweeps for text in sweep.info.losses):
        passed_over(loss)
    models = {sweep.plan.model for sweep in sweeps}
    if len(models) > 1:
        raise DataError(f"the recordings identify different models: {', '.join(sorted(models))}")
    refuse_copies(sweeps)
    if corrections is not None:
        sweeps = [corrected(sweep, corrections) for sweep in sweeps]
    for correction in (item for sweep in sweeps for item in sweep.corrections):
        changed(correction)
    return sweeps


def evaluate_sweeps(
    analysis: type[Analysis],
    sweeps: Sequence[RecordedSweep],
    options: Options,
    notify: Callable[[str], None],
) -> Evaluation:
    """Return what ``analysis`` makes of ``sweeps``; raises as :func:`evaluate` does."""
    _check_options(sweeps[0].plan.model, analysis, options)
    optional = analysis.needs.optional_signals
    return analysis().evaluate([sweep.without(optional) for sweep in sweeps], options, notify)


def _check_options(model: str, analysis: type[Analysis], options: Options) -> None:
    """Refuse an option that the analysis does not use.

    Raises:
        ConfigError: there is one.
    """
    for name, (message, hint) in _REFUSED.items():
        given = getattr(options, name) != getattr(Options, name)
        if given and name not in analysis.options:
            raise ConfigError(message.format(model), hint=hint)
