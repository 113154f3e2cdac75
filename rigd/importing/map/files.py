"""Sorts the files that are given into tests: which file is which source of which test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rigd.importing.map.map import ImportMap, SourceMap
from rigd.importing.map.patterns import Pattern
from rigd.model.errors import ConfigError


@dataclass
class SourceFiles:
    """The files of one test by source; ``texts`` are what `{name}` stands for in their names."""

    name: str
    root: Path
    files: dict[str, Path] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)


def sort_files(what: ImportMap, files: Sequence[Path]) -> list[SourceFiles]:
    """Return the tests that ``files`` hold, in their order.

    Raises:
        ConfigError: a file is missing or belongs to no source, or a test lacks a file or has two
            for one source; names each.
    """
    found: dict[tuple[str, ...], SourceFiles] = {}
    problems: list[ConfigError] = []
    shared = _shared(list(what.sources.values()))
    for path in dict.fromkeys(files):
        if not path.is_file():
            problems.append(ConfigError(f"there is no file {path}"))
            continue
        if any(pattern.match(path) is not None for pattern in _passed_over(what)):
            continue
        matched = False
        for source in what.sources.values():
            texts = _texts(source, path)
            if texts is None:
                continue
            matched = True
            root = path.absolute().parent if source.pattern is None else source.pattern.root(path)
            words = [texts[name] for name in shared]
            name = "-".join(words) or root.name
            if len(what.sources) == 1:
                name = path.stem
                words = [str(path)] if source.pattern is None else words
            test = found.setdefault((str(root), *words), SourceFiles(name, root))
            if source.name in test.files:
                problems.append(
                    ConfigError(
                        f"{test.files[source.name]} and {path} are both the source {source.name} "
                        f"of the test {test.name!r}",
                        hint="give each a source of its own with `file:`, such as "
                        "'{test}_force.csv', or a {name} that tells tests apart",
                    )
                )
                continue
            test.files[source.name] = path
            test.texts.update(texts)
        if not matched:
            patterns = ", ".join(s.pattern.text for s in what.sources.values() if s.pattern)
            problems.append(
                ConfigError(f"{path} belongs to no source of the map: none of {patterns}",
                            hint="leave it out, or name it under `ignore:` in the map")
            )  # fmt: skip
    for test in found.values():
        problems += _lacking(what, test)
    if problems:
        raise ConfigError.several(problems)
    if not found:
        raise ConfigError("none of the files has samples for the map")
    return list(found.values())


def _passed_over(what: ImportMap) -> list[Pattern]:
    table = what.trials.table
    return [*what.ignore, *([] if table is None else [table])]


def _shared(sources: Sequence[SourceMap]) -> list[str]:
    """Return the names in braces that all sources have: they tell tests apart."""
    every = [source.pattern.fields if source.pattern else [] for source in sources]
    return [name for name in every[0] if all(name in other for other in every[1:])]


def _texts(source: SourceMap, path: Path) -> Mapping[str, str] | None:
    return {} if source.pattern is None else source.pattern.match(path)


def _lacking(what: ImportMap, test: SourceFiles) -> list[ConfigError]:
    problems = []
    for source in what.sources.values():
        if source.name not in test.files and source.pattern is not None:
            expected = source.pattern.filled(test.texts) or source.pattern.text
            there = ", ".join(str(path) for path in test.files.values())
            problems.append(
                ConfigError(
                    f"the test {test.name!r} has no file for the source {source.name}, such as "
                    f"{expected}; it has {there}",
                    hint="add it to the files of the command",
                )
            )
    return problems
