"""What an analysis is: it declares what it needs, and turns recordings into an evaluation."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.sdk.analysis import DeclaredAnalysis

if TYPE_CHECKING:
    from rigd.analysis.source import RecordedSweep
    from rigd.analysis.terminal import TerminalReport


@dataclass(frozen=True)
class Options:
    """How to identify.

    ``starts``, ``seed`` and ``robust`` are for analyses that fit: number of starts, their seed,
    robust loss instead of least squares. ``calibration`` is for analyses that work from raw volts:
    a file to use instead of the calibration that a recording carries. ``by_recording`` gives each
    recording groups of its own, so that they can be compared.
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
    def terminal_report(self) -> TerminalReport:
        """Return what a terminal shows."""


class Analysis(DeclaredAnalysis):
    """The analysis of a family of rigs, found by its entry point below ``rigd.analyses``.

    The entry point's name is the ``model`` of a procedure's ``identify``. The module of the class
    is imported whenever a plan is checked: numerics are imported in :meth:`evaluate`.
    """

    @abstractmethod
    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, tell: Callable[[str], None]
    ) -> Evaluation:
        """Return what ``sweeps`` say, the recordings of one campaign in the order given.

        ``tell`` gets a line before each step that takes long.

        Raises:
            RecordingError: a recording is damaged.
            ConfigError: a calibration is wrong.
            DataError: the data cannot answer; the message says why, the hint what to do.
        """
