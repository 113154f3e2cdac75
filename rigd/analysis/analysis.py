"""Defines the base class of analyses: a class declares its needs and evaluates recordings."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from rigd.sdk.analysis import DeclaredAnalysis

if TYPE_CHECKING:
    from rigd.analysis.design.command import Designed, DesignRequest
    from rigd.analysis.estimates import Estimate
    from rigd.analysis.recordings.source import RecordedSweep, TrialInfo
    from rigd.analysis.report import Heading, Opening
    from rigd.analysis.result import Curve
    from rigd.analysis.terminal import TerminalReport
    from rigd.analysis.validation.result import Validation
    from rigd.analysis.validation.saved_models import SavedModel


@dataclass(frozen=True)
class Options:
    """Options of an identification.

    ``starts``, ``seed`` and ``robust`` are for analyses that fit: number of starts, their seed,
    robust loss instead of least squares. ``calibration`` is for analyses that work from raw volts:
    a file to use instead of the calibration that a recording carries. ``by_recording`` gives each
    recording groups of its own, so that they can be compared. ``method`` names one of the ways
    that the analysis has, ``law`` a friction law that is installed; empty: its own choice.
    ``compare`` asks which of the installed laws the data support. ``joint`` fits the groups with
    the constants of the rig in common.
    ``processes`` is how many may compute side by side (:mod:`rigd.analysis.side_by_side`); it
    changes no result.
    ``model`` is a saved model that gives what the recordings do not determine well.
    """

    starts: int = 8
    seed: int = 1
    robust: bool = False
    calibration: Path | None = None
    by_recording: bool = False
    method: str = ""
    law: str = ""
    compare: bool = False
    joint: bool = False
    processes: int = 1
    model: Path | None = None


class Evaluation(ABC):
    """The result of evaluating recordings."""

    title: str

    @property
    def fits(self) -> bool:
        """Whether the numbers may be used; if not, `rigd identify` ends with a code of its own."""
        return True

    @property
    def opening(self) -> Opening | None:
        """What of it may be used and what may not: the first that a person reads."""
        return None

    @property
    def heading(self) -> Heading | None:
        """Origin of the data: simulated or not, rig, operator, specimen, dates."""
        return None

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Each number that is given or refused; none if the analysis gives no numbers."""
        return ()

    @property
    def curves(self) -> Mapping[str, Curve]:
        """The fitted characteristic of each group that has one, by its name in the estimates."""
        return {}

    @abstractmethod
    def report(self) -> str:
        """Return the report as a self-contained HTML page."""

    @abstractmethod
    def to_json(self) -> dict[str, object]:
        """Return the results as an object for ``json.dumps(..., allow_nan=False)``."""

    @abstractmethod
    def terminal_report(self) -> TerminalReport:
        """Return what a terminal shows."""


class Analysis(DeclaredAnalysis):
    """The analysis of a family of rigs, found by its entry point below ``rigd.analyses``.

    The entry point's name is the ``model`` of a procedure's ``identify``. The module of the class
    is imported whenever a plan is checked: numerics are imported in :meth:`evaluate`.
    """

    @abstractmethod
    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        """Return the result of ``sweeps``, the recordings of one campaign in the order given.

        ``notify`` gets a line before each step that takes long.

        Raises:
            RecordingError: a recording is damaged.
            ConfigError: a calibration is wrong.
            DataError: the data cannot answer; the message gives the reason, the hint what to do.
        """


@runtime_checkable
class ChecksTrials(Protocol):
    """What an analysis has besides if it can judge a trial by itself, while the run goes on."""

    def check_trial(self, sweep: RecordedSweep, trial: TrialInfo) -> Sequence[str]:
        """Return why ``trial`` cannot be used, a sentence each; nothing if it can.

        It is called between two trials, so it takes a second at most.

        Raises:
            RecordingError: the recording is damaged.
            ConfigError: a calibration is wrong.
            DataError: the recording lacks what the analysis needs.
        """


@runtime_checkable
class Validates(Protocol):
    """What an analysis has besides if its models can be tried on other recordings."""

    def validate(
        self,
        models: Sequence[SavedModel],
        sweeps: Sequence[RecordedSweep],
        group: str,
        notify: Callable[[str], None],
    ) -> Validation:
        """Return how ``sweeps`` agree with ``models``, those of one file, for `rigd validate`.

        ``group`` names the model to take for any recordings; empty: the one whose
        conditions are those of the trials (:func:`rigd.analysis.validation.saved_models.chosen`).
        ``notify`` gets a line before each step that takes long.

        Raises:
            RecordingError: a recording is damaged.
            ConfigError: a model cannot be simulated, or none is for these conditions.
            DataError: the data cannot answer; the message gives the reason, the hint what to do.
        """


@runtime_checkable
class Designs(Protocol):
    """What an analysis has besides if tests can be designed for its models."""

    def design(self, request: DesignRequest, notify: Callable[[str], None]) -> Designed:
        """Return tests that make the intervals of the targets narrow, for `rigd design`.

        ``notify`` gets a line before each step that takes long.

        Raises:
            ConfigError: a model cannot be used, or a target is unknown.
            DataError: the time is too short, or no test reaches a target.
        """
