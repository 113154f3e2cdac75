"""Recordings in; what their model makes of them out, with report, JSON and terminal table."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from rigd.analysis.copies import refuse_copies, refuse_same_file
from rigd.analysis.models import needs_of
from rigd.analysis.source import RecordedSweep, open_sweep
from rigd.analysis.terminal import Shown
from rigd.model.errors import DataError


@dataclass(frozen=True)
class Options:
    """How to identify.

    ``starts``, ``seed`` and ``robust`` are for models that are fitted: number of starts, their
    seed, robust loss instead of least squares. ``calibration`` is for models that work from raw
    volts: a file to use instead of the calibration that a recording carries. ``by_recording`` gives
    each recording groups of its own, so that they can be compared.
    """

    starts: int = 8
    seed: int = 1
    robust: bool = False
    calibration: Path | None = None
    by_recording: bool = False


class Evaluation(ABC):
    """What was found in the recordings."""

    title: str

    @abstractmethod
    def report(self) -> str:
        """Return the report as a self-contained HTML page."""

    @abstractmethod
    def to_json(self) -> dict[str, object]:
        """Return the results as an object for ``json.dumps(..., allow_nan=False)``."""

    @abstractmethod
    def shown(self) -> Shown:
        """Return what a terminal shows."""


#: What the module of a model offers as ``evaluate``: recordings of one campaign, in the order they
#: were given, to its evaluation. It tells a line before each step that takes long, and raises
#: DataError where the data cannot answer.
Evaluator = Callable[[Sequence[RecordedSweep], Options, Callable[[str], None]], Evaluation]


def evaluate(
    paths: Sequence[Path],
    options: Options | None = None,
    *,
    tell: Callable[[str], None] = lambda _: None,
    passed_over: Callable[[str], None] = lambda _: None,
) -> Evaluation:
    """Identify what ``paths`` hold; trials of one group may stand in several recordings.

    ``tell`` gets a line before each step that takes long, ``passed_over`` one for all that is
    damaged or lost in a recording.

    Raises:
        RecordingError: a file cannot be read.
        ConfigError: an option does not fit the model, or a calibration is wrong.
        DataError: a file holds nothing to identify, is there twice or beside a copy of itself, or
            the data cannot answer.
    """
    refuse_same_file(paths)
    sweeps = [open_sweep(path) for path in paths]
    for loss in (text for sweep in sweeps for text in sweep.info.losses):
        passed_over(loss)
    models = {sweep.plan.model for sweep in sweeps}
    if len(models) > 1:
        raise DataError(f"the recordings identify different models: {', '.join(sorted(models))}")
    refuse_copies(sweeps)
    evaluator: Evaluator = import_module(needs_of(sweeps[0].plan).module).evaluate
    return evaluator(sweeps, options or Options(), tell)
