"""Compares campaigns for programs: ``rigd.compare``, which the command calls too."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from rigd.analysis.analysis import Options
from rigd.analysis.api import (
    Recorded,
    Result,
    corrections_of,
    find_parameter,
    paths_of,
    write_report,
)
from rigd.analysis.compare.campaign import files_of, grouped, read_campaigns, short_names
from rigd.analysis.compare.comparison import Compared
from rigd.analysis.compare.comparison import compare as compare_campaigns
from rigd.analysis.compare.evaluation import ComparisonEvaluation
from rigd.analysis.compare.texts import change_texts, named, value_text
from rigd.analysis.recordings.corrections import Corrections
from rigd.model.errors import ConfigError, DataError
from rigd.model.machine.extras import require
from rigd.record import Recording, Table

if TYPE_CHECKING:
    import pandas as pd

#: A recording, a folder, a pattern, a JSON file of `rigd identify`; several of them; or a result.
Group = Recorded | Sequence[Recorded] | Result


@dataclass(frozen=True, repr=False)
class ComparisonResult:
    """What differs between campaigns: ``comparison["sigma_0"]`` is one parameter in all of them.

    ``losses`` are sentences on what is damaged or lost in the recordings.
    """

    evaluation: ComparisonEvaluation
    losses: tuple[str, ...] = ()

    @property
    def campaigns(self) -> tuple[str, ...]:
        """The names of the campaigns, in order; differences are from the first."""
        return tuple(item.name for item in self.evaluation.comparison.campaigns)

    @property
    def fits(self) -> bool:
        """Whether the model fits in all campaigns."""
        return self.evaluation.fits

    @property
    def parameters(self) -> tuple[Compared, ...]:
        """All parameters, those included that could not be compared."""
        return self.evaluation.comparison.compared

    @property
    def different(self) -> tuple[Compared, ...]:
        """The parameters in which the campaigns differ."""
        return self.evaluation.comparison.different

    def __getitem__(self, key: str | tuple[str, str]) -> Compared:
        """Return a parameter by its name, or by group of trials and name if there are several.

        Raises:
            KeyError: there is none, or several groups have it.
        """
        known = [named(item) for item in self.parameters]
        return find_parameter(self.parameters, key, str(known))

    @cached_property
    def table(self) -> Table:
        """The differences as a table, a row for each parameter and campaign but the first.

        ``relative`` differences are shares of the first value; 0.05 is 5 %. A number that is not
        given is NaN, an open end is infinite.
        """
        rows = [
            (item, name, item.changes.get(name, (math.nan,) * 3))
            for item in self.parameters
            for name in (item.changes or self.campaigns[1:])
        ]

        def texts(values: Sequence[str]) -> np.ndarray:
            return np.array(values, object)

        columns = {
            "group": texts([item.group for item, _, _ in rows]),
            "parameter": texts([item.name for item, _, _ in rows]),
            "from": texts([item.base or self.campaigns[0] for item, _, _ in rows]),
            "to": texts([name for _, name, _ in rows]),
            "difference": np.array([change[0] for _, _, change in rows], np.float64),
            "low": np.array([change[1] for _, _, change in rows], np.float64),
            "high": np.array([change[2] for _, _, change in rows], np.float64),
            "relative": np.array([item.log for item, _, _ in rows], np.bool_),
            "unit": texts([item.unit for item, _, _ in rows]),
            "p_value": np.array(
                [math.nan if item.test is None else item.p_holm for item, _, _ in rows], np.float64
            ),
            "verdict": texts([item.verdict for item, _, _ in rows]),
        }
        docs = {
            "low": "lower end of the 95 % interval",
            "high": "upper end of the 95 % interval",
            "p_value": "of all campaigns being equal, for all parameters together (Holm)",
        }
        return Table("differences", columns, {}, docs)

    def to_pandas(self) -> pd.DataFrame:
        """Return the table as a DataFrame.

        Raises:
            RecordingError: pandas is not installed.
        """
        return self.table.to_pandas()

    def to_json(self) -> dict[str, object]:
        """Return the object that ``--json`` prints, for ``json.dump(..., allow_nan=False)``."""
        return {**self.evaluation.to_json(), "lost": list(self.losses)}

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the report, a self-contained HTML page; return its path.

        Raises:
            ConfigError: ``path`` would overwrite a recording.
            RecordingError: the file cannot be written.
        """
        return write_report(self.evaluation, path)

    def __repr__(self) -> str:
        lines = [f"<{' and '.join(self.campaigns)}>", *self.evaluation.sentences]
        return "\n".join([*lines, *self.losses])

    def _repr_html_(self) -> str:
        heads = ["parameter", *self.campaigns, "unit", "difference", "95 % interval", "verdict"]
        lines = ["".join(f"<th>{escape(head)}</th>" for head in heads)]
        for item in self.parameters:
            changes = [change_texts(item, found) for found in item.differences.values()]
            cells = [
                named(item),
                *(value_text(item, campaign) for campaign in self.evaluation.comparison.campaigns),
                item.unit,
                "; ".join(change for change, _ in changes),
                "; ".join(ends for _, ends in changes),
                item.verdict,
            ]
            lines.append("".join(f"<td>{escape(cell)}</td>" for cell in cells))
        return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def compare(
    *groups: Group,
    names: Sequence[str] = (),
    by: str = "",
    method: Literal["", "output-error", "slip-force"] = "",
    law: str = "",
    set: Mapping[str, object] | None = None,
    processes: int = 1,
    notify: Callable[[str], None] = lambda _: None,
) -> ComparisonResult:
    """Compare campaigns parameter by parameter: what ``rigd compare`` does.

    Args:
        groups: what each campaign consists of: a recording, its path, a folder, a pattern with
            ``*``, a JSON file of `rigd identify`, a sequence of recordings and paths, or a result
            of :func:`rigd.identify`, which is not identified again.
        names: how the campaigns are called; empty: by their files.
        by: pool all recordings and group them by ``year``, ``month``, ``day``, ``recording``,
            ``specimen`` or ``meta.KEY``.
        method: how parameters are estimated, the same for all; empty: the analysis chooses.
        law: the friction law to fit; empty: that of the analysis.
        set: other values for constants, in all campaigns.
        processes: how many copies of this process may compute at once; more than 1 only in a
            program without threads, which a notebook is not.
        notify: gets a line before each campaign.

    Raises:
        RecordingError: a file cannot be read.
        ConfigError: an option is wrong, a name is missing, or a JSON file is no result.
        DataError: there is one group only, two have a recording in common or are of different
            rigs, models or methods, or the data of a group cannot answer.
        MissingExtra: the libraries of an analysis are not installed.
    """
    require("analysis", "rigd.compare")
    given = [item if isinstance(item, Result) else _paths(item) for item in groups]
    if by:
        paths: list[Path] = []
        for item in given:
            if isinstance(item, Result):
                raise ConfigError(
                    f"by={by!r}: a result cannot be grouped", hint="give the recordings"
                )
            paths += item
        if names:
            raise ConfigError(f"by={by!r} names the groups itself", hint="leave names out")
        campaigns: Mapping[str, Sequence[Path] | Result] = grouped(paths, by)
    else:
        campaigns = dict(zip(_names(groups, given, names), given, strict=True))
    options = Options(method=method, law=law, processes=processes)
    return compared(campaigns, options, corrections_of(set or {}, None), notify)


def compared(
    groups: Mapping[str, Sequence[Path] | Result],
    options: Options,
    corrections: Corrections,
    notify: Callable[[str], None],
) -> ComparisonResult:
    """Return the comparison of ``groups``, by name; raises as :func:`compare` does."""
    losses: list[str] = []
    campaigns = read_campaigns(groups, options, corrections, notify, losses.append)
    return ComparisonResult(ComparisonEvaluation(compare_campaigns(campaigns)), tuple(losses))


def _paths(group: Recorded | Sequence[Recorded]) -> list[Path]:
    if isinstance(group, Recording):
        return [group.path]
    if isinstance(group, str | os.PathLike):
        return files_of(os.fspath(group))
    return paths_of(group)


def _names(
    groups: Sequence[Group], given: Sequence[list[Path] | Result], names: Sequence[str]
) -> list[str]:
    """Return a name for each group: as given, that of its argument or only file, or its number.

    Raises:
        ConfigError: ``names`` are not as many, or two are the same.
    """
    if names:
        if len(names) != len(groups) or len({*names}) != len(names):
            raise ConfigError(
                f"{len(groups)} groups have the names {list(names)}",
                hint="give each group a name of its own, or none",
            )
        return list(names)
    written = [
        os.fspath(group)
        if isinstance(group, str | os.PathLike)
        else str(paths[0])
        if not isinstance(paths, Result) and len(paths) == 1
        else f"group {number}"
        for number, (group, paths) in enumerate(zip(groups, given, strict=True), start=1)
    ]
    twice = next((item for item in written if written.count(item) > 1), None)
    if twice is not None:
        raise DataError(
            f"{twice} is given twice", hint="give it once: a file does not differ from itself"
        )
    return short_names(written)
