"""Identifies recordings for programs: ``rigd.identify``, which the command calls too."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol, TypeVar

import numpy as np

from rigd.analysis.analysis import Evaluation, Options
from rigd.analysis.estimates import Estimate
from rigd.analysis.evaluation import evaluate_sweeps, open_sweeps
from rigd.analysis.measures import formulas_behind
from rigd.analysis.plain_data import plain_object
from rigd.analysis.plan import analysis_of
from rigd.analysis.recordings.corrections import Corrections
from rigd.analysis.recordings.source import Correction, RecordedSweep
from rigd.model.errors import ConfigError, DataError, RecordingError
from rigd.model.machine.extras import require
from rigd.model.machine.folders import make_folder
from rigd.procedure.loader import load_procedure
from rigd.record import Recording, RunInfo, Table
from rigd.record.read.moment import recorded_at

if TYPE_CHECKING:
    import pandas as pd

#: A recording, or the path of one.
Recorded = Recording | str | os.PathLike[str]


class Grouped(Protocol):
    """What has a name, and a group of trials that it is of."""

    @property
    def group(self) -> str:
        """The group of trials."""
        ...

    @property
    def name(self) -> str:
        """The name, once in each group."""
        ...


G = TypeVar("G", bound=Grouped)


def find_parameter(parameters: Sequence[G], key: str | tuple[str, str], known: str) -> G:
    """Return a parameter by its name, or by group and name; ``known`` says which there are.

    Raises:
        KeyError: there is none, or several groups have it.
    """
    group, name = key if isinstance(key, tuple) else (None, key)
    found = [p for p in parameters if p.name == name and group in (None, p.group)]
    if len(found) == 1:
        return found[0]
    if not found:
        raise KeyError(f"no parameter {key!r}; there are {known}")
    groups = [item.group for item in found]
    raise KeyError(f"several groups have {name!r}: give (group, name), groups are {groups}")


@dataclass(frozen=True)
class ResultOrigin:
    """Where numbers come from: one recording, with the calibration that it states.

    ``recorded`` is its date in UTC (ISO 8601), "" if it is not known. ``constants`` are those that
    its evaluation rests on and that all its trials have in common: value and standard uncertainty
    in SI, None if none is stated. ``formulas`` are those of the derived channels behind the signals
    that were identified, by channel.
    """

    recording: str
    rig: str
    procedure: str
    model: str
    recorded: str
    calibration: Mapping[str, str]
    meta: Mapping[str, str]
    constants: Mapping[str, tuple[float, float | None]] = field(default_factory=dict)
    formulas: Mapping[str, str] = field(default_factory=dict)

    @staticmethod
    def of_sweep(sweep: RecordedSweep) -> ResultOrigin:
        """Return the origin that an identified recording states."""
        plan = sweep.plan
        constants = {
            name: (float(value), u.of(value) if (u := plan.uncertainties.get(name)) else None)
            for name, value in plan.constants.items()
            if not isinstance(value, str)
        }
        formulas = formulas_behind(sweep.recording, plan.signals.values())
        origin = ResultOrigin.of(sweep.info, plan.model)
        return replace(origin, constants=constants, formulas=formulas)

    @staticmethod
    def of(info: RunInfo, model: str) -> ResultOrigin:
        """Return the origin that a recording states; ``model`` is what was made of it."""
        try:
            recorded = recorded_at(info).at.astimezone(UTC).isoformat()
        except OSError:
            recorded = ""
        return ResultOrigin(
            str(info.path), info.rig, info.procedure, model, recorded,
            dict(info.metadata.get("calibration", {})), dict(info.metadata.get("meta", {})),
        )  # fmt: skip


@dataclass(frozen=True, repr=False)
class Result:
    """What an evaluation found: ``result["sigma_0"]`` is a number, or the reason why there is none.

    ``losses`` are sentences on what is damaged or lost in the recordings, ``corrections`` the
    constants that were not taken as recorded, ``origins`` the recordings.
    """

    evaluation: Evaluation
    losses: tuple[str, ...] = ()
    corrections: tuple[Correction, ...] = ()
    origins: tuple[ResultOrigin, ...] = ()

    @property
    def title(self) -> str:
        """What was evaluated."""
        return self.evaluation.title

    @property
    def fits(self) -> bool:
        """Whether the model fits in all groups; if not, there are no numbers of those groups."""
        return self.evaluation.fits

    @cached_property
    def parameters(self) -> tuple[Estimate, ...]:
        """The parameters of all groups, those included that the data do not determine."""
        return self.evaluation.estimates

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups of trials that were evaluated separately, such as the floors."""
        return tuple(dict.fromkeys(item.group for item in self.parameters))

    def __getitem__(self, key: str | tuple[str, str]) -> Estimate:
        """Return a parameter by its name, or by group and name if there are several groups.

        Raises:
            KeyError: there is none, or several groups have it.
        """
        known = list(dict.fromkeys(item.name for item in self.parameters))
        return find_parameter(self.parameters, key, f"{known} of groups {list(self.groups)}")

    @cached_property
    def table(self) -> Table:
        """The parameters as a table; a number that is not given is NaN."""
        items = self.parameters

        def numbers(values: Iterable[float | None]) -> np.ndarray:
            return np.array([np.nan if v is None else v for v in values], np.float64)

        def texts(values: Iterable[str]) -> np.ndarray:
            return np.array(list(values), object)

        columns = {
            "group": texts(item.group for item in items),
            "parameter": texts(item.name for item in items),
            "value": numbers(item.value for item in items),
            "low": numbers(item.low for item in items),
            "high": numbers(item.high for item in items),
            "unit": texts(item.unit for item in items),
            "determined": np.array([item.determined for item in items], np.bool_),
            "verdict": texts(item.verdict for item in items),
            "reason": texts(item.reason for item in items),
        }
        docs = {"low": "lower end of the 95 % interval", "high": "upper end of the 95 % interval"}
        return Table("parameters", columns, {}, docs)

    def to_pandas(self) -> pd.DataFrame:
        """Return the table as a DataFrame.

        Raises:
            RecordingError: pandas is not installed.
        """
        return self.table.to_pandas()

    def to_json(self) -> dict[str, object]:
        """Return the object that ``--json`` prints, for ``json.dump(..., allow_nan=False)``."""
        corrected = [
            {**asdict(item), "recording": str(item.recording)} for item in self.corrections
        ]
        return {
            **self.evaluation.to_json(),
            "lost": list(self.losses),
            "corrected": corrected,
            "origins": [asdict(origin) for origin in self.origins],
            "estimates": [plain_object(item) for item in self.parameters],
            "curves": [
                {"group": group, **plain_object(item)}
                for group, item in self.evaluation.curves.items()
            ],
        }

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the report, a self-contained HTML page; return its path.

        Raises:
            ConfigError: ``path`` would overwrite a recording.
            RecordingError: the file cannot be written.
        """
        return write_report(self.evaluation, path)

    def figures(self, folder: str | os.PathLike[str]) -> int:
        """Write the figures of the report as SVG, PDF and CSV; return how many there are.

        Raises:
            RecordingError: a file cannot be written.
        """
        from rigd.analysis.report.files import saving_figures

        try:
            with saving_figures(Path(folder)) as files:
                self.evaluation.report()
        except OSError as error:
            raise RecordingError(f"cannot write figures to {folder}: {error.strerror}") from error
        return len(files.shown)

    def __repr__(self) -> str:
        return "\n".join([f"<{self.title}>", *map(repr, self.parameters), *self.losses])

    def _repr_html_(self) -> str:
        heads = ("", "parameter", "value", "95 % interval", "unit", "verdict")
        rows = [
            (
                item.group, item.name,
                "–" if item.value is None else f"{item.value:.6g}",
                "" if item.value is None else f"{_end(item.low)} to {_end(item.high)}",
                item.unit, item.verdict,
            )
            for item in self.parameters
        ]  # fmt: skip
        lines = ["".join(f"<th>{escape(head)}</th>" for head in heads)]
        lines += ["".join(f"<td>{escape(cell)}</td>" for cell in row) for row in rows]
        return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def identify(
    recordings: Recorded | Sequence[Recorded],
    *,
    method: Literal["", "output-error", "slip-force"] = "",
    law: str = "",
    joint: bool = False,
    by_recording: bool = False,
    compare: bool = False,
    robust: bool = False,
    starts: int = 8,
    seed: int = 1,
    calibration: str | os.PathLike[str] | None = None,
    model: str | os.PathLike[str] | None = None,
    set: Mapping[str, object] | None = None,
    plan: str | os.PathLike[str] | None = None,
    processes: int = 1,
    notify: Callable[[str], None] = lambda _: None,
) -> Result:
    """Identify friction parameters from recordings: what ``rigd identify`` does.

    Args:
        recordings: recordings or their paths; trials of one group may stand in several.
        method: how the parameters are estimated; empty: the analysis chooses.
        law: the friction law to fit; empty: that of the analysis.
        joint: whether groups share the constants of the rig.
        by_recording: identify each recording separately.
        compare: also state which of the installed friction laws the data support.
        robust: Huber loss instead of least squares.
        starts: number of starts of the fit.
        seed: seed of the random starts.
        calibration: convert raw volts with this calibration, not with the recordings' own.
        model: JSON of ``rigd identify`` that gives what the recordings do not determine.
        set: other values for constants, such as ``{"wheel_radius": "50 mm +- 0.1 mm"}``.
        plan: a procedure whose ``identify`` block counts, not the recorded one.
        processes: how many copies of this process may compute at once; more than 1 only in a
            program without threads, which a notebook is not.
        notify: gets a line before each step that takes long.

    Raises:
        RecordingError: a file cannot be read.
        ConfigError: an option does not fit the analysis, or a value is wrong.
        DataError: the recordings hold nothing to identify, or the data cannot answer.
        MissingExtra: the libraries of an analysis are not installed.
    """
    require("analysis", "rigd.identify")
    options = Options(
        starts, seed, robust, None if calibration is None else Path(calibration), by_recording,
        method, law, compare, joint, processes, None if model is None else Path(model),
    )  # fmt: skip
    corrections = corrections_of(set or {}, plan)
    return identified(paths_of(recordings), options, corrections, notify)


def identified(
    paths: Sequence[Path],
    options: Options,
    corrections: Corrections,
    notify: Callable[[str], None],
) -> Result:
    """Return what the recordings at ``paths`` hold; raises as :func:`identify` does."""
    if not 1 <= options.starts <= 1000:
        raise ConfigError(f"--starts {options.starts} must be between 1 and 1000")
    losses: list[str] = []
    changed: list[Correction] = []
    sweeps = open_sweeps(paths, losses.append, corrections, changed.append)
    evaluation = evaluate_sweeps(analysis_of(sweeps[0].plan), sweeps, options, notify)
    origins = tuple(map(ResultOrigin.of_sweep, sweeps))
    return Result(evaluation, tuple(losses), tuple(changed), origins)


def corrections_of(
    assigned: Mapping[str, object], plan: str | os.PathLike[str] | None
) -> Corrections:
    """Return the constants ``assigned`` by name, and the `identify` block of ``plan``.

    Raises:
        ConfigError: the procedure is missing or wrong.
    """
    texts = {name: str(value) for name, value in assigned.items()}
    return Corrections(texts, None if plan is None else load_procedure(os.fspath(plan)))


def paths_of(recordings: Recorded | Sequence[Recorded]) -> list[Path]:
    """Return the paths of recordings.

    Raises:
        DataError: there are none.
    """
    if isinstance(recordings, Recording | str | os.PathLike):
        recordings = [recordings]
    given = list(recordings)
    if not given:
        raise DataError("no recording is given", hint="give one or several recordings")
    return [item.path if isinstance(item, Recording) else Path(item) for item in given]


def write_report(evaluation: Evaluation, path: str | os.PathLike[str]) -> Path:
    """Write the report of an evaluation; return its path.

    Raises:
        ConfigError: ``path`` would overwrite a recording.
        RecordingError: the file cannot be written.
    """
    page = Path(path)
    refuse_recording("the report", page)
    make_folder(page.parent, "--report")
    try:
        page.write_text(evaluation.report(), encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"cannot write the report {page}: {error.strerror}") from error
    return page


def refuse_recording(what: str, path: Path) -> None:
    """Refuse to write ``what`` over a recording.

    Raises:
        ConfigError: ``path`` is that of one.
    """
    if path.suffix == ".mcap":
        raise ConfigError(f"{what} {path} would overwrite a recording")


def _end(value: float | None) -> str:
    return "open" if value is None else f"{value:.6g}"
