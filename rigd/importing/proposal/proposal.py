"""Proposes a map for files of another program, and tries it on them."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from rigd.importing.importer import import_files
from rigd.importing.map.map_reader import parse_map
from rigd.importing.proposal.columns import name_of
from rigd.importing.proposal.dialect import MISSING
from rigd.importing.proposal.lines import MapLine, block, comment, quoted
from rigd.importing.proposal.tables import ProposedSource, tables_in
from rigd.importing.tables.library_warnings import listening
from rigd.model.errors import ConfigError, RecordingError, RigdError

#: A key that a hint of the import names, with its value.
_KEY: Final = re.compile(r"`(\w+):(?: ([^`]+))?`")
#: The block of each key that is asked for if the import refuses a file for want of it.
_BLOCKS: Final = {
    "restarts": "time", "wraps": "time", "coarse": "time", "longest_gap": "time", "zone": "time",
    "since": "time", "open_end": "text", "last": "text", "missing": "text", "decimal": "text",
    "encoding": "text", "gaps": "trials", "warnings": "map",
}  # fmt: skip
_TRIES: Final = 16
_PARTS: Final = re.compile(r"[_\-. ]")


@dataclass(frozen=True)
class Proposal:
    """A proposed map: its name, its text, and the lines that are to be filled in, from 1."""

    name: str
    text: str
    blanks: Sequence[int]


def propose(files: Sequence[Path]) -> Proposal:
    """Return a map for ``files``, from what stands in them.

    What they do not show is left to the user as a line to fill in. With these lines filled by a
    guess the map is tried: the files are imported to a folder that is then removed.

    Raises:
        ConfigError: a file cannot be read, or has no table of samples.
    """
    with listening():  # what libraries warn of shows when the map is tried
        sources = _sources(files)
    draft = _Draft(sources, files)
    for _ in range(_TRIES):
        fault = draft.fault()
        if fault is None or not draft.ask(fault):
            break
    text = draft.text(guess=False)
    blanks = [at for at, line in enumerate(text.splitlines(), 1) if "  # to fill in: " in line]
    return Proposal(draft.name, text, blanks)


def _sources(files: Sequence[Path]) -> list[tuple[str, MapLine | None, ProposedSource]]:
    """Return the sources: names, patterns of their files, tables of their first files."""
    layouts: dict[object, list[list[ProposedSource]]] = {}
    for path in dict.fromkeys(files):
        tables = tables_in(path)
        layouts.setdefault(tuple((item.group, item.names) for item in tables), []).append(tables)
    sources: dict[str, tuple[str, MapLine | None, ProposedSource]] = {}
    single = len(layouts) == 1 and all(len(parts[0]) == 1 for parts in layouts.values())
    every = [str(path.name) for path in files]
    for parts in layouts.values():
        pattern = None if single else _pattern([item[0].path.name for item in parts], every)
        for found in parts[0]:
            base = "samples"
            if pattern is not None and len(layouts) > 1:
                base = Path(pattern.replace("{test}", "")).stem
            if len(parts[0]) > 1:
                base = found.group or found.names[0].rpartition("/")[0] or base
            name = name_of(base, sources)
            line = None if pattern is None else MapLine("file", quoted(pattern))
            sources[name] = (name, line, found)
    return list(sources.values())


def _pattern(own: Sequence[str], every: Sequence[str]) -> str:
    """Return the pattern of the files ``own`` among ``every``: `{test}` and what they share."""
    if len(set(every)) == 1:
        return f"{{test}}{Path(own[0]).suffix}"
    if len(own) > 1:
        shared = _shared([name[::-1] for name in own])[::-1]
        match = _PARTS.search(shared)
        return "{test}" + (shared[match.start() :] if match else shared)
    shared = _shared(list(every))
    ends = [match.start() for match in _PARTS.finditer(shared)]
    return "{test}" + own[0][ends[-1] :] if ends and ends[-1] else own[0]


@dataclass
class _Draft:
    """A map that is being written."""

    sources: Sequence[tuple[str, MapLine | None, ProposedSource]]
    files: Sequence[Path]
    top: list[MapLine] = field(default_factory=list)
    trials: list[MapLine] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        for name, _, found in self.sources:
            if found.trials and not self.trials:
                if len(self.sources) > 1:
                    self.trials.append(MapLine("source", name))
                columns = ", ".join(quoted(item) for item in found.trials)
                self.trials.append(
                    MapLine("columns", f"[{columns}]", "a trial ends where one changes")
                )
                if found.steps is not None:
                    self.trials.append(MapLine("steps", quoted(found.steps)))
            elif found.steps is not None:
                found.notes.append(f"left out: {found.steps}; `steps:` below `trials:` takes it")

    @property
    def name(self) -> str:
        """The name of the map, by those of the files."""
        stems = [path.stem for path in self.files]
        shared = _shared(stems).rstrip("_-. 0123456789") or stems[0]
        return name_of(shared if len(stems) > 1 else stems[0], {})

    def fault(self) -> ConfigError | None:
        """Return what the import finds wrong with the files, None if nothing."""
        try:
            what = parse_map(self.text(guess=True), Path(f"{self.name}.yaml"))
            with TemporaryDirectory() as folder:
                import_files(what, self.files, Path(folder))
        except ConfigError as error:
            return error
        except RecordingError as error:
            return ConfigError(error.message, hint=error.hint)
        return None

    def ask(self, fault: ConfigError) -> bool:
        """Put what the import asks for into the map, to be filled in; return whether there is any.

        Texts that usually mean that there is no value are taken for that.
        """
        match = next((m for m in _KEY.finditer(fault.hint or "") if m[1] in _BLOCKS), None)
        says = _said(fault)
        if match is None:
            self.refused.append(says)
            return False
        key, value = match[1], match[2] or "2000-01-01"
        for lines, found in self._blocks(_BLOCKS[key], fault):
            if key == "missing" and found is not None:
                texts = [str(item) for item in ast.literal_eval(value)]
                new = [item for item in texts if item not in found.missing]
                if new and all(item in MISSING for item in new):
                    found.missing += new
                    return True
            if all(line.key != key for line in lines):
                lines.append(MapLine(key, _yaml(value), says, asks=True))
                return True
        self.refused.append(says)
        return False

    def _blocks(
        self, block: str, fault: ConfigError
    ) -> list[tuple[list[MapLine], ProposedSource | None]]:
        """Return the lines of the blocks that the fault may be of."""
        if block in ("map", "trials"):
            return [(self.top if block == "map" else self.trials, None)]
        file = "" if fault.place is None else fault.place.file
        own = [found for _, _, found in self.sources if file in ("", str(found.path))]
        own = own or [found for _, _, found in self.sources]
        return [(item.text if block == "text" else item.clock.lines, item) for item in own]

    def text(self, *, guess: bool) -> str:
        """Return the map; ``guess``: with a value wherever one is to be filled in."""
        files = ", ".join(path.name for path in self.files[:4])
        more = f" and {len(self.files) - 4} more" if len(self.files) > 4 else ""
        lines = [
            f"# Proposed by `rigd import --propose` from {_plain(files + more)}.",
            '# Fill in each "?", and correct what is wrong: names, units, times, trials.',
            *(f"# `rigd import` refuses the files: {_plain(item)}" for item in self.refused),
            f"map: {self.name}",
            "rig: unknown  # the name of the rig that the data are from",
            *block(self.top, "", guess=guess),
        ]
        if not all(found.clock.dated for _, _, found in self.sources):
            lines.append(
                "# started: 2016-03-04T10:00:00Z  # the file shows no day: that of the file counts"
            )
        lines.append("sources:")
        for name, file, found in self.sources:
            lines += self._source(name, file, found, guess=guess)
        if self.trials:
            lines += ["trials:", *block(self.trials, "  ", guess=guess)]
        elif len(self.files) > len(self.sources):
            lines.append("# trials: each test, by the names of its files, is one trial")
        return "\n".join(lines) + "\n"

    def _source(
        self, name: str, file: MapLine | None, found: ProposedSource, *, guess: bool
    ) -> list[str]:
        lines = [f"  {name}:", *(f"    # {_plain(note)}" for note in found.notes)]
        if file is not None:
            lines += block([file], "    ", guess=guess)
        if found.group is not None:
            lines.append(f"    group: {quoted(found.group)}")
        text = list(found.text)
        if found.missing and all(line.key != "missing" for line in text):
            listed = ", ".join(quoted(item) if item else '""' for item in found.missing)
            text.append(MapLine("missing", f"[{listed}]", "no value"))
        if text:
            lines += ["    text:", *block(text, "      ", guess=guess)]
        lines += ["    time:", *block(found.clock.lines, "      ", guess=guess), "    channels:"]
        channels: Mapping[str, str] = found.channels if guess else found.asked
        return [*lines, *(f"      {key}: {item}" for key, item in channels.items())]


def _shared(texts: Sequence[str]) -> str:
    """Return the letters with which all of ``texts`` begin."""
    first, last = min(texts), max(texts)
    same = next((at for at, letter in enumerate(first) if last[at : at + 1] != letter), len(first))
    return first[:same]


def _said(fault: RigdError) -> str:
    first = str(fault).partition("\n")[0]
    return f"{first}; {fault.hint}" if fault.hint else first


def _yaml(value: str) -> str:
    """Return a value that a hint states, as a map has it."""
    return value if value.startswith(("[", "'", '"')) else quoted(value)


def _plain(text: str) -> str:
    return comment(text).removeprefix("  # ")
