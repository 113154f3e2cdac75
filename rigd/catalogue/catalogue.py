"""Searches a folder of recordings; its index is made and brought up to date on the way."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigd.catalogue.facts import Listing
from rigd.catalogue.index import index_path, lines, opened, update
from rigd.catalogue.query import Condition
from rigd.catalogue.statement import stated, statement_of
from rigd.language.syntax import ComparisonChain, Name, Node, Operation

if TYPE_CHECKING:
    from rigd.model import RecordingError

#: Another process writes the index.
_IN_USE: Final = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)


@dataclass(frozen=True)
class Broken:
    """A recording that cannot be read, and the reason."""

    path: Path
    problem: RecordingError


@dataclass(frozen=True)
class Found:
    """The recordings that match, by file name, and the files that could not be read.

    ``stated``: if none matches, the values that the recordings have instead, by field.
    """

    lines: tuple[Listing, ...]
    broken: tuple[Broken, ...]
    stated: Mapping[str, Sequence[str]] = field(default_factory=dict)


def search(
    folder: Path,
    condition: Condition | None = None,
    progress: Callable[[int, int], None] = lambda _, __: None,
) -> Found:
    """Return the recordings in a folder and its subfolders for which ``condition`` holds.

    ``progress`` is called with how many files were read, of how many. An index that is damaged or
    of another version is made again; where none can be kept, one is made in memory.

    Raises:
        RecordingError: the folder is missing.
        ConfigError: the condition names an unknown field, or another unit.
    """
    if not folder.is_dir():
        from rigd.model import RecordingError

        raise RecordingError(f"{folder} is no folder of recordings")
    path = _place(folder)
    if path is not None:
        try:
            return _searched(path, folder, condition, progress)
        except sqlite3.OperationalError as error:
            if getattr(error, "sqlite_errorcode", None) in _IN_USE:
                path = None
        except (sqlite3.Error, OSError):
            pass
    if path is not None:
        with suppress(sqlite3.Error, OSError):
            path.unlink(missing_ok=True)
            return _searched(path, folder, condition, progress)
    return _searched(None, folder, condition, progress)


def _place(folder: Path) -> Path | None:
    try:
        return index_path(folder)
    except (OSError, RuntimeError):  # a user without a home
        return None


def _searched(
    path: Path | None,
    folder: Path,
    condition: Condition | None,
    progress: Callable[[int, int], None],
) -> Found:
    with opened(path) as index:
        unread = update(index, folder, progress)
        where = ("1", ()) if condition is None else statement_of(condition, index)
        found = lines(index, *where)
        instead = {} if found or condition is None else _stated(index, condition)
    return Found(tuple(found), tuple(Broken(*item) for item in unread), instead)


def _stated(index: sqlite3.Connection, condition: Node) -> dict[str, Sequence[str]]:
    """Return which values each field has that ``condition`` compares with a text or a word."""
    match condition:
        case Operation(operands=parts):
            return {name: texts for part in parts for name, texts in _stated(index, part).items()}
        case ComparisonChain(signs=("==" | "in" | "contains", *_), operands=(Name() as field, *_)):
            texts = stated(index, field)
            return {field.name: texts} if texts else {}
    return {}
