"""Reads the campaigns to compare: recordings, which are identified, or results of an analysis."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import numpy as np

from rigd.analysis.analysis import Options
from rigd.analysis.api import Result, ResultOrigin, identified
from rigd.analysis.estimates import Estimate, Share
from rigd.analysis.measures import MeasureResult, measured
from rigd.analysis.measures.view import definition
from rigd.analysis.recordings.corrections import Corrections
from rigd.analysis.recordings.duplicates import refuse_copies, refuse_same_file
from rigd.analysis.recordings.source import open_sweep
from rigd.analysis.report.opening import listed
from rigd.analysis.result import Curve, FloatArray, Verdict
from rigd.model.errors import ConfigError, DataError, RecordingError
from rigd.model.units import parse_unit, si_symbol
from rigd.record import Recording
from rigd.record.read.moment import recorded_at

#: What stands behind a measure in place of a model.
MEASURES: Final = "measures"


@dataclass(frozen=True)
class Campaign:
    """Numbers of one campaign under the name that it has in the comparison.

    ``method`` is how they were estimated, by group of trials; ``refused`` are sentences on groups
    that the analysis refuses. Of measures, ``conditions`` are all parameters of the trials of each
    group as shown, ``points`` the same in SI, ``formulas`` those of the derived channels behind
    each measure.
    """

    name: str
    origins: tuple[ResultOrigin, ...]
    estimates: tuple[Estimate, ...]
    curves: Mapping[str, Curve] = field(default_factory=dict)
    method: Mapping[str, str] = field(default_factory=dict)
    refused: tuple[str, ...] = ()
    conditions: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    points: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    formulas: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    @property
    def model(self) -> str:
        """What was made of the recordings, such as the model of the analysis."""
        return ", ".join(sorted({origin.model for origin in self.origins}))

    @property
    def fits(self) -> bool:
        """Whether its model fits in all groups of trials, and none is refused."""
        misfits = (item.verdict == Verdict.MISFIT.value for item in self.estimates)
        return not self.refused and not any(misfits)

    @property
    def rigs(self) -> tuple[str, ...]:
        """The rigs that recorded it."""
        return tuple(sorted({origin.rig for origin in self.origins}))

    @property
    def dates(self) -> tuple[datetime, ...]:
        """When its recordings were made, in order; empty if one has no date."""
        texts = [origin.recorded for origin in self.origins]
        return tuple(sorted(map(datetime.fromisoformat, texts))) if all(texts) else ()

    @property
    def calibrations(self) -> tuple[str, ...]:
        """The calibrations that its recordings state, each with its day."""
        found = (origin.calibration for origin in self.origins if origin.calibration)
        return tuple(dict.fromkeys(_calibration(item) for item in found))


def named_groups(given: Sequence[str]) -> dict[str, list[Path]]:
    """Return a group for each argument under a short name, its last part.

    Raises:
        ConfigError: an argument has no file.
        DataError: an argument is given twice.
    """
    twice = next((item for item in given if given.count(item) > 1), None)
    if twice is not None:
        raise DataError(
            f"{twice} is given twice", hint="give it once: a file does not differ from itself"
        )
    return dict(zip(short_names(given), map(files_of, given), strict=True))


def short_names(given: Sequence[str]) -> list[str]:
    """Return the last part of each argument, or the arguments if those are not all different."""
    short = [Path(item).stem if Path(item).suffix else Path(item).name for item in given]
    return short if len(set(short)) == len(short) and all(short) else list(given)


def files_of(given: str) -> list[Path]:
    """Return the recordings of one argument: a file, a folder, or a pattern with ``*``.

    Raises:
        ConfigError: there is none, or it is no pattern.
    """
    path = Path(given)
    if path.is_dir():
        found = sorted(path.glob("*.mcap"))
        if not found:
            raise ConfigError(f"{given} has no recording", hint="give a folder with .mcap files")
        return found
    if any(letter in given for letter in "*?[") and not path.exists():
        root = Path(path.anchor) if path.is_absolute() else Path()
        try:
            found = sorted(root.glob(str(path.relative_to(path.anchor) if path.anchor else path)))
        except ValueError as error:
            raise ConfigError(f"{given}: {error}", hint="such as runs/*.mcap") from error
        if not found:
            raise ConfigError(f"no file matches {given}", hint="check the pattern")
        return found
    return [path]


def read_campaigns(
    groups: Mapping[str, Sequence[Path] | Result],
    options: Options,
    corrections: Corrections,
    notify: Callable[[str], None],
    passed_over: Callable[[str], None],
) -> list[Campaign]:
    """Return the campaigns of ``groups``, each identified by itself.

    A group is recordings, one JSON file of ``rigd identify``, or a result. Recordings without a
    plan to identify are compared by what their procedures measure.

    Raises:
        RecordingError: a file cannot be read.
        ConfigError: an option or correction is wrong, or given where nothing is identified; a JSON
            file is no result, or shares a group.
        DataError: a file is in two groups, or the data of a group cannot answer: names the group.
    """
    files = {name: group for name, group in groups.items() if not isinstance(group, Result)}
    recordings = {name: paths for name, paths in files.items() if not _is_result(paths)}
    every = [path for paths in files.values() for path in paths]
    refuse_same_file(every)
    _refuse_same_bytes(every)
    plain = [path for paths in recordings.values() for path in paths]
    measuring = bool(plain) and not any(map(_identifies, plain))
    _refuse_options(groups, options, corrections, measuring=measuring)
    if not measuring:
        _refuse_copies_in(plain)
    found = []
    for name, paths in groups.items():
        if isinstance(paths, Result):
            found.append(of_result(name, paths))
            continue
        notify(f"{name}: {len(paths)} {'file' if len(paths) == 1 else 'files'}")
        try:
            if _is_result(paths):
                found.append(of_json(name, paths[0]))
            elif measuring:
                found.append(of_measures(name, paths))
            else:
                result = identified(paths, options, corrections, lambda line: None)
                for loss in result.losses:
                    passed_over(loss)
                found.append(of_result(name, result))
        except DataError as error:
            raise DataError(f"group {name}: {error.message}", hint=error.hint) from error
    return found


def of_result(name: str, result: Result) -> Campaign:
    """Return the campaign of what was identified."""
    return of_object(name, result.to_json())


def of_json(name: str, path: Path) -> Campaign:
    """Return the campaign of a JSON file that ``rigd identify --json`` wrote.

    Raises:
        ConfigError: it is no such file.
    """
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path} cannot be read: {error}") from error
    try:
        return of_object(name, told)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ConfigError(
            f"{path} is no result of `rigd identify --json`, or of an older version",
            hint="identify the recordings again, or give the recordings",
        ) from error


def of_object(name: str, told: Mapping[str, Any]) -> Campaign:
    """Return the campaign of an object as :meth:`rigd.analysis.api.Result.to_json` makes it.

    Raises:
        KeyError, TypeError, AttributeError, ValueError: it is no such object.
    """
    parts = told.get("groups", [told])
    return Campaign(
        name,
        tuple(ResultOrigin(**item) for item in told["origins"]),
        tuple(_estimate(item) for item in told["estimates"]),
        {item["group"]: _curve(item) for item in told["curves"]},
        {part["group"]: f"{part['model']}, {part['method']}" for part in parts if "group" in part},
        tuple(f"{item['group']}: {item['reason']}" for item in told.get("refused", ())),
    )


def of_measures(name: str, paths: Sequence[Path]) -> Campaign:
    """Return the campaign of what the procedures of recordings measure.

    Raises:
        RecordingError: a file cannot be read.
        DataError: there is nothing to measure, or the recordings do not measure the same.
    """
    recordings = [Recording.open(path) for path in paths]
    origins = tuple(ResultOrigin.of(recording.info, MEASURES) for recording in recordings)
    return campaign_of_measures(name, origins, measured(recordings))


def campaign_of_measures(
    name: str, origins: tuple[ResultOrigin, ...], result: MeasureResult
) -> Campaign:
    """Return the campaign of measures; its groups are named by all parameters of their trials."""
    groups = {label_of(item.conditions): item for item in result.summaries}
    return Campaign(
        name,
        origins,
        _measure_estimates(result),
        conditions={group: item.conditions for group, item in groups.items()},
        points={group: item.point for group, item in groups.items()},
        formulas=result.formulas,
    )


def label_of(condition: Mapping[str, str]) -> str:
    """Return the name of a group of trials with these parameters."""
    return ", ".join(f"{name} {text}" for name, text in condition.items())


def _measure_estimates(result: MeasureResult) -> tuple[Estimate, ...]:
    """Return the means of measures over equal trials as estimates.

    The stated uncertainty of a measure is common to all groups. Where all means are equal, a step
    of the sensor hides their scatter: it is then the group's own, and nothing of it cancels.
    """
    found = []
    for item in result.summaries:
        known = item.mean is not None and item.low is not None and item.u is not None
        stated, effect = item.measure.systematic, item.systematic or 0.0
        shares: tuple[Share, ...] = ()
        u, freedom = item.u, float(max(item.freedom, 1))
        if u == 0.0:
            u, freedom = effect, math.inf
        elif stated is not None:
            shares = (Share(f"u of {item.measure.name}", 0.0, stated.size, effect),)
        found.append(
            Estimate(
                label_of(item.conditions), item.measure.name,
                si_symbol(parse_unit(item.measure.unit).dimension),
                item.mean if known else None, item.low, item.high, known,
                "measured" if known else "not determined", item.why, definition(item.measure),
                shares=shares, u=u if known else None, freedom=freedom,
                is_within_run=item.is_within_run,
            )
        )  # fmt: skip
    return tuple(found)


def grouped(paths: Sequence[Path], by: str) -> dict[str, list[Path]]:
    """Return recordings by their ``month``, ``day``, ``year``, ``recording`` or ``meta.KEY``.

    Months and days are those of UTC, in order; ``specimen`` is the name that was stated. A
    recording is named by its file, or by its path if two files have one name.

    Raises:
        RecordingError: a file cannot be read.
        ConfigError: ``by`` is no such thing.
        DataError: a recording does not have it.
    """
    dated = {"year": "%Y", "month": "%Y-%m", "day": "%Y-%m-%d"}
    key = "specimen" if by == "specimen" else by.removeprefix("meta.")
    if by not in dated and by not in ("specimen", "recording") and not by.startswith("meta."):
        raise ConfigError(
            f"--by {by}: recordings are grouped by year, month, day, recording, specimen or "
            "meta.KEY",
            hint="--by month, or --by meta.batch",
        )
    found: dict[str, list[Path]] = {}
    for path in paths:
        info = Recording.open(path, partial=True).info
        if by == "recording":
            name = str(path)
        elif by in dated:
            name = recorded_at(info).at.strftime(dated[by])
        else:
            name = info.metadata.get("meta", {}).get(key, "")
            if by == "specimen":
                name = info.specimen.get("name", "") or name
        if not name:
            option = "--specimen NAME" if by == "specimen" else f"--meta {key}=VALUE"
            raise DataError(
                f"--by {by}: {path} has no {key}",
                hint=f"`rigd run` records it with {option}; leave this file out",
            )
        found.setdefault(name, []).append(path)
    if by == "recording":
        found = dict(zip(short_names(list(found)), found.values(), strict=True))
    return dict(sorted(found.items()))


def _refuse_options(
    groups: Mapping[str, Sequence[Path] | Result],
    options: Options,
    corrections: Corrections,
    *,
    measuring: bool,
) -> None:
    """Refuse options of an identification for groups that are not identified.

    Raises:
        ConfigError: there is such a group, and an option.
    """
    given = [f"--set {name}={text}" for name, text in corrections.constants.items()]
    given += [f"--law {options.law}"] if options.law else []
    given += [f"--method {options.method}"] if options.method else []
    for name, paths in groups.items() if given else ():
        if isinstance(paths, Result) or _is_result(paths):
            why = "is a result, which is not identified again"
            hint = "give the recordings of all groups, or leave the option out"
        elif measuring:
            why = "is compared by what its procedure measures: nothing is identified"
            hint = "leave the option out; a procedure with an `identify` block has it"
        else:
            continue
        raise ConfigError(f"{', '.join(given)}: group {name} {why}", hint=hint)


def _refuse_same_bytes(paths: Sequence[Path]) -> None:
    """Refuse a file and a copy of it under another name.

    Raises:
        RecordingError: a file cannot be read.
        DataError: there is a copy.
    """
    seen: dict[str, Path] = {}
    for path in paths:
        try:
            with path.open("rb") as stream:
                digest = hashlib.file_digest(stream, "sha256").hexdigest()
        except OSError as error:
            raise RecordingError(f"{path} cannot be read: {error.strerror}") from error
        if digest in seen:
            raise DataError(
                f"{path} is a copy of {seen[digest]}",
                hint="give it once: a file does not differ from itself",
            )
        seen[digest] = path


def _refuse_copies_in(paths: Sequence[Path]) -> None:
    """Refuse recordings of all groups that hold a trial twice.

    Raises:
        DataError: they do.
        RecordingError: a file cannot be read.
    """
    sweeps = [open_sweep(path) for path in paths]
    try:
        refuse_copies(sweeps)
    except DataError as error:
        message = f"the groups hold a trial twice: {error.message}"
        raise DataError(message, hint=error.hint) from error


def _identifies(path: Path) -> bool:
    return "identify" in Recording.open(path, partial=True).metadata


def _is_result(paths: Sequence[Path]) -> bool:
    """Return whether a group is a JSON file.

    Raises:
        ConfigError: it is one with other files.
    """
    found = any(path.suffix == ".json" for path in paths)
    if found and len(paths) > 1:
        files = listed([str(path) for path in paths])
        raise ConfigError(
            f"{files} are one group: one result is a group by itself",
            hint="give each JSON file as a group of its own, or the recordings of all",
        )
    return found


def _estimate(told: Mapping[str, Any]) -> Estimate:
    freedom = told["freedom"]
    return Estimate(
        **{
            **told,
            "shares": tuple(Share(**item) for item in told["shares"]),
            "freedom": math.inf if freedom is None else float(freedom),
        }
    )


def _curve(told: Mapping[str, Any]) -> Curve:
    def array(name: str) -> FloatArray:
        return np.array([math.nan if value is None else value for value in told[name]], np.float64)

    return Curve(
        told["name"], told["x_name"], told["x_unit"], told["y_name"], told["y_unit"],
        array("x"), array("y"), array("low"), array("high"), told["note"],
    )  # fmt: skip


def _calibration(item: Mapping[str, str]) -> str:
    made = f" of {item['made']}" if item.get("made") else ""
    return f"{item.get('name') or 'unnamed'}{made}"
