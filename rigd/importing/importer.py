"""Writes recordings of tests: all of them, or none if one has a mistake."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd import __version__
from rigd.config.lab.lab import SPECIMEN_FILE, Specimen, stated_specimen
from rigd.importing.map.files import SourceFiles, sort_files
from rigd.importing.map.map import ImportMap
from rigd.importing.reading import SourceReader, find_trials_in, open_source, prefetched
from rigd.importing.tables.library_warnings import listening
from rigd.importing.tables.table import HasMoments
from rigd.importing.trial_facts import FoundTrial, found_trials
from rigd.model.about import About
from rigd.model.errors import ConfigError, RecordingError
from rigd.model.machine.folders import make_folder
from rigd.model.rows import TIME_FIELD
from rigd.model.units import format_quantity
from rigd.procedure.identify import plan_metadata
from rigd.record import Attachment, Recording, RecordingWriter
from rigd.record.events.event import NO_TRIAL
from rigd.record.mcap.prefix import FORMAT_METADATA
from rigd.record.read.info import stated_metadata

#: Name of the map in a recording.
MAP_FILE: Final = "import_map.yaml"
#: Metadata record of what a recording was imported from.
IMPORT_METADATA: Final = "import"
#: The clock of another computer may be so far ahead.
_AHEAD: Final = timedelta(days=2)
#: Mode of the run of an imported recording.
IMPORTED: Final = "imported"
NOTHING_STATED: Final = About()


@dataclass(frozen=True)
class Imported:
    """One recording that was made: its file, what it is from, and what it holds."""

    path: Path
    files: tuple[Path, ...]
    trials: int
    rows: Mapping[str, int]


def import_files(
    what: ImportMap,
    files: Sequence[Path],
    folder: Path,
    *,
    overwrite: bool = False,
    about: About = NOTHING_STATED,
) -> list[Imported]:
    """Write a recording of each test in ``files`` to ``folder``; return them in order.

    Each recording states ``about``, with the file of its specimen, if there is one below the
    current folder. Memory is bounded: some 10 MB of each source are held at once.

    Raises:
        ConfigError: the map, a file or that of the specimen has a mistake, each named with its
            place; no recording is written then, not of the other files either.
        RecordingError: a recording exists already (unless ``overwrite``), or cannot be written.
    """
    specimen = stated_specimen(about, None)
    tests = sort_files(what, files)
    targets = _targets(tests, folder, overwrite=overwrite)
    make_folder(folder, "--out")
    done: list[tuple[Imported, Path]] = []
    problems: list[ConfigError] = []
    with ExitStack() as cleanup:
        for test, target in zip(tests, targets, strict=True):
            # A half recording never has the final name.
            part = target.with_name(f".{target.name}.part")
            part.unlink(missing_ok=True)
            cleanup.callback(part.unlink, missing_ok=True)
            try:
                done.append((_Import(what, test, target, about, specimen).write(part), part))
            except ConfigError as error:
                problems.append(error)
        if problems:
            raise ConfigError.several(problems)
        for imported, part in done:
            part.replace(imported.path)
    return [imported for imported, _ in done]


def _targets(tests: Sequence[SourceFiles], folder: Path, *, overwrite: bool) -> list[Path]:
    targets = [folder / f"{test.name}.mcap" for test in tests]
    for index, target in enumerate(targets):
        if target in targets[:index]:
            raise ConfigError(
                f"two tests would be written to {target}",
                hint="import them one after the other, each with another --out",
            )
        if target.exists() and not overwrite:
            raise RecordingError(
                f"{target} exists already", hint="choose another --out, or give --overwrite"
            )
    return targets


class _Import:
    """Makes one recording."""

    def __init__(
        self, what: ImportMap, test: SourceFiles, target: Path, about: About, specimen: Specimen
    ) -> None:
        self._what = what
        self._test = test
        self._target = target
        self._about = about
        self._specimen = specimen

    def write(self, part: Path) -> Imported:
        """Write the recording to ``part``.

        Raises:
            ConfigError: a file has a mistake, or a library warns while it reads one.
            RecordingError: the recording cannot be written.
        """
        with listening() as heard:
            imported = self._write(part, heard)
        return replace(imported, rows={**imported.rows, **self._add_derived(part)})

    def _add_derived(self, part: Path) -> Mapping[str, int]:
        """Write ``part`` anew with the derived channels of the map; return the rows of each group.

        Raises:
            ConfigError: a derived channel is wrong.
            RecordingError: the recording cannot be written.
        """
        what = self._what
        if not what.derived:
            return {}
        recording = Recording.open(part)
        full = recording.with_channels(what.document, what.derived)
        what.check_signals(full.streams)
        metadata = {n: v for n, v in recording.metadata.items() if n != FORMAT_METADATA}
        draft = part.with_name(f"{part.name}.derived")
        draft.unlink(missing_ok=True)
        try:
            with RecordingWriter.create(
                draft,
                streams=list(full.streams.values()),
                metadata=metadata,
                attachments=list(recording.attachments.values()),
                start_ns=recording.start_ns,
                sync_interval_s=None,
            ) as writer:
                for name in full.streams:
                    for rows in full.batches(name):
                        writer.write(name, rows)
                for event in recording.all_events:
                    trial = None if event.trial == NO_TRIAL else event.trial
                    writer.event(event.t_ns, event.kind, trial, event.data)
            draft.replace(part)
        finally:
            draft.unlink(missing_ok=True)
        return {name: full.count(name) for name in full.streams.keys() - recording.streams.keys()}

    def _write(self, part: Path, heard: Sequence[str]) -> Imported:
        what, paths = self._what, self._test.files
        before = {name: _stamp(path) for name, path in paths.items()}
        base_ns, started_from = self._base()
        readers = {
            name: open_source(source, paths[name], base_ns, started=what.started_ns is not None)
            for name, source in what.sources.items()
        }
        what.check_signals({name: reader.stream for name, reader in readers.items()})
        first = readers[what.trials.source]
        first.finder = find_trials_in(what, first)
        if any(_dated(reader) for reader in readers.values()):
            started_from = "the times in the file"
        elif what.started_ns is None and any(r.table.start_ns for r in readers.values()):
            started_from = "the start that the file states"
        with ThreadPoolExecutor(1) as pool, ExitStack() as open_files:
            digests = {path: pool.submit(_sha256, path) for path in dict.fromkeys(paths.values())}
            batches = {
                name: open_files.enter_context(_Batches(reader)) for name, reader in readers.items()
            }
            start_ns = min(item.start_ns for item in batches.values())
            self._check_past(start_ns)
            metadata = self._metadata(start_ns)
            streams = [reader.stream for reader in readers.values()]
            texts = {MAP_FILE: what.document.text, SPECIMEN_FILE: self._specimen.text}
            with RecordingWriter.create(
                part,
                streams=streams,
                metadata=metadata,
                attachments=[
                    Attachment(name, "application/yaml", text.encode())
                    for name, text in texts.items()
                    if text
                ],
                start_ns=start_ns,
                sync_interval_s=None,
            ) as writer:
                for name, item in batches.items():
                    for rows in item:
                        writer.write(name, rows)
                trials = found_trials(what, self._test, readers)
                _write_events(
                    writer, what, trials, start_ns, max(item.end_ns for item in batches.values())
                )
                hashes = {path: digest.result() for path, digest in digests.items()}
                self._check_unchanged(before)
                self._check_warned(heard)
                origin = self._origin(readers, hashes, started_from)
                origin["warnings"] = "; ".join(dict.fromkeys(heard))
                run = {"trials": str(len(trials)), "imported_from": _in_words(origin)}
                writer.add_metadata({"run": run, IMPORT_METADATA: origin})
        return Imported(
            self._target,
            tuple(dict.fromkeys(paths.values())),
            len(trials),
            {name: reader.rows for name, reader in readers.items()},
        )

    def _check_past(self, start_ns: int) -> None:
        """Refuse data of the future: their times count from another moment than the map states."""
        began = datetime.fromtimestamp(start_ns * 1e-9, UTC)
        if began > datetime.now(UTC) + _AHEAD:
            raise ConfigError(
                f"the samples of {self._test.name} would be of {began:%Y-%m-%d}, in the future",
                place=self._what.document.key_place(("sources",)),
                hint="state below `time:` which moment a time of 0 means: `since: 1970-01-01` for "
                "Unix times",
            )

    def _check_warned(self, heard: Sequence[str]) -> None:
        if heard and not self._what.accepts_warnings:
            names = ", ".join(str(path) for path in dict.fromkeys(self._test.files.values()))
            raise ConfigError(
                f"a library warns while it reads {names}: {'; '.join(dict.fromkeys(heard))}",
                place=self._what.document.key_place(("sources",)),
                hint="the file may be damaged, or hold what the library cannot read; if that does "
                "not matter for your channels, add `warnings: accept` to the map",
            )

    def _check_unchanged(self, before: Mapping[str, tuple[int, int]]) -> None:
        for name, path in self._test.files.items():
            if _stamp(path) != before[name]:
                raise ConfigError(f"{path} was changed while it was read", hint="import it again")

    def _base(self) -> tuple[int, str]:
        """Return when a test with relative times began, in ns, and what shows it."""
        if self._what.started_ns is not None:
            return self._what.started_ns, "the map"
        return min(path.stat().st_mtime_ns for path in self._test.files.values()), (
            "the date of the file"
        )

    def _metadata(self, start_ns: int) -> dict[str, dict[str, str]]:
        what = self._what
        fixed = {
            name: str(item.value) if item.unit is None else _written(item.value, item.unit.symbol)
            for name, item in what.parameters.items()
            if item.value is not None
        }
        metadata = {
            "run": {
                "procedure": what.name,
                "title": what.title,
                "rig": what.rig,
                "mode": IMPORTED,
                "seed": "",
                "started": datetime.fromtimestamp(start_ns * 1e-9, UTC).isoformat(),
                "rigd_version": __version__,
            },
            "parameters": fixed,
        }
        if what.plan is not None:
            metadata["identify"] = plan_metadata(what.plan)
        return metadata | stated_metadata(self._about, self._specimen, metadata["run"])

    def _origin(
        self, readers: Mapping[str, SourceReader], hashes: Mapping[Path, str], started_from: str
    ) -> dict[str, str]:
        files = [
            {
                "source": name,
                "file": path.name,
                "bytes": path.stat().st_size,
                "sha256": hashes[path],
                "rows": readers[name].rows,
            }
            for name, path in self._test.files.items()
        ]
        return {
            "map": self._what.path.name,
            "map_sha256": hashlib.sha256(self._what.document.text.encode()).hexdigest(),
            "started_from": started_from,
            "times": "; ".join(
                f"{name}: {done}"
                for name, reader in readers.items()
                if (done := reader.times.statement(reader.rows))
            ),
            "files": json.dumps(files, ensure_ascii=False),
        }


class _Batches:
    """The batches of one source, read ahead; the first is read at once, for its first time."""

    def __init__(self, reader: SourceReader) -> None:
        self._reader = reader
        self.end_ns = 0

    def __enter__(self) -> _Batches:
        self._items = prefetched(self._reader.batches())
        self._first = next((rows for rows in self._items if len(rows)), None)
        if self._first is None:
            self._items.close()
            raise ConfigError(
                f"{self._reader.table.path} has no sample for {self._reader.source.name}"
            )
        return self

    def __exit__(self, *_: object) -> None:
        self._items.close()

    @property
    def start_ns(self) -> int:
        """Time of the first sample."""
        return 0 if self._first is None else int(self._first[TIME_FIELD][0])

    def __iter__(self) -> Iterator[NDArray[np.void]]:
        if self._first is not None:
            yield self._counted(self._first)
        for rows in self._items:
            yield self._counted(rows)

    def _counted(self, rows: NDArray[np.void]) -> NDArray[np.void]:
        if len(rows):
            self.end_ns = int(rows[TIME_FIELD][-1])
        return rows


def _write_events(
    writer: RecordingWriter,
    what: ImportMap,
    trials: Sequence[FoundTrial],
    start_ns: int,
    end_ns: int,
) -> None:
    writer.event(start_ns, "run_start", None, {"procedure": what.name, "resumed": False})
    for trial in trials:
        about = {
            "number": trial.number,
            "repeat": trial.repeat,
            "parameters": dict(trial.parameters),
            "units": dict(trial.units),
        }
        writer.event(trial.start_ns, "trial_start", trial.number, about)
        for t_ns, name in trial.steps:
            writer.event(t_ns, "step", trial.number, {"name": name})
        ended = {"complete": not trial.problem, "reason": trial.problem}
        writer.event(trial.end_ns, "trial_end", trial.number, ended)
    complete = sum(not trial.problem for trial in trials)
    writer.event(
        max(end_ns, *(trial.end_ns for trial in trials)),
        "run_end",
        None,
        {
            "state": "complete" if complete == len(trials) else "incomplete",
            "reason": "imported",
            "trials_done": complete,
            "trials_total": len(trials),
        },
    )


def _dated(reader: SourceReader) -> bool:
    time, table, column = reader.source.time, reader.table, reader.times.clock.column
    moments = column is not None and isinstance(table, HasMoments) and table.is_moment(column)
    return moments or time.since_ns is not None or time.format is not None


def _stamp(path: Path) -> tuple[int, int]:
    stat = path.stat()
    return stat.st_size, stat.st_mtime_ns


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _in_words(origin: Mapping[str, str]) -> str:
    files = {item["file"]: item for item in json.loads(origin["files"])}
    return "; ".join(
        f"{name}, {item['bytes']} bytes, sha256 {item['sha256']}" for name, item in files.items()
    )


def _written(value: float | str | None, unit: str) -> str:
    return format_quantity(value, unit) if isinstance(value, float) else str(value)
