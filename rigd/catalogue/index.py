"""Keeps the facts on the recordings of a folder in a file of SQLite, and brings it up to date.

The file stands in the user's cache, not beside the recordings: their folder may be read-only, on a
network disk on which SQLite cannot lock, or in a backup. It may be deleted at any time.
"""

from __future__ import annotations

import hashlib
import os
import sqlite3
import sys
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigd import __version__
from rigd.catalogue.facts import Fact, Listing, facts_of, line_of

if TYPE_CHECKING:
    from rigd.model import RecordingError

#: Counts up when what stands in the file changes; another one is made anew.
_FORMAT: Final = 3
#: What `PRAGMA user_version` has in a file that this program made.
_VERSION: Final = zlib.crc32(f"{_FORMAT} {__version__}".encode()) & 0x7FFFFFFF
#: So many recordings are read between two commits: what is lost if the process is killed.
_BATCH: Final = 500
#: Another process that brings the file up to date is waited for this long.
_WAIT_S: Final = 5.0
#: In quotes: SQL has words such as `set` itself.
_COLUMNS: Final = tuple(f'"{field.name}"' for field in fields(Listing))
_SCHEMA: Final = f"""
CREATE TABLE recordings(
    id INTEGER PRIMARY KEY, bytes INTEGER, mtime_ns INTEGER, {", ".join(_COLUMNS)}, UNIQUE(file)
);
CREATE TABLE names(id INTEGER PRIMARY KEY, name TEXT UNIQUE);
CREATE TABLE facts(
    name INTEGER, recording INTEGER, place INTEGER, text TEXT, number REAL, unit TEXT,
    PRIMARY KEY(name, recording, place)
) WITHOUT ROWID;
"""

#: A recording that cannot be read, and why.
Unread = tuple[Path, "RecordingError"]


def index_path(folder: Path) -> Path:
    """Return the path of the index of a folder."""
    name = hashlib.sha256(os.path.realpath(folder).encode("utf-8", "surrogateescape")).hexdigest()
    return _cache() / "rigd" / "index" / f"{name[:32]}.sqlite"


def _cache() -> Path:
    """Return the folder of the user's caches, by the XDG base directory specification."""
    given = os.environ.get("XDG_CACHE_HOME", "")
    if Path(given).is_absolute():
        return Path(given)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    return Path.home() / ".cache"


@contextmanager
def opened(path: Path | None) -> Iterator[sqlite3.Connection]:
    """Open an index, or make it; None makes one in memory.

    Raises:
        sqlite3.Error: the file is no index, damaged, locked, or cannot be written.
        OSError: its folder cannot be made.
    """
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
    where = ":memory:" if path is None else str(path)
    with closing(sqlite3.connect(where, timeout=_WAIT_S, isolation_level=None)) as index:
        # The function `lower` of SQLite leaves all letters but a to z as they are.
        index.create_function("casefold", 1, str.casefold, deterministic=True)
        (version,) = index.execute("PRAGMA user_version").fetchone()
        if version != _VERSION:
            _make(index)
        yield index


def _make(index: sqlite3.Connection) -> None:
    """Make the tables, in place of those of another version."""
    index.execute("BEGIN IMMEDIATE")
    tables = index.execute(
        "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite_%'"
    ).fetchall()
    for (name,) in tables:
        quoted = name.replace('"', '""')
        index.execute(f'DROP TABLE "{quoted}"')
    for statement in _SCHEMA.split(";"):
        index.execute(statement)
    index.execute(f"PRAGMA user_version = {_VERSION}")
    index.execute("COMMIT")


def update(
    index: sqlite3.Connection, folder: Path, progress: Callable[[int, int], None]
) -> list[Unread]:
    """Read what is new or changed by size or date, forget what is gone; return what is unreadable.

    ``progress`` is called with how many were read, of how many.
    """
    present = _present(folder)
    if _known(index) == present:
        return []
    unread: list[Unread] = []
    index.execute("BEGIN IMMEDIATE")
    try:
        known = _known(index)  # another process may have been at it
        _forget(index, [file for file, stamp in known.items() if present.get(file) != stamp])
        todo = sorted(file for file, stamp in present.items() if known.get(file) != stamp)
        names: dict[str, int] = {
            name: number for number, name in index.execute("SELECT id, name FROM names")
        }
        for number, file in enumerate(todo):
            progress(number, len(todo))
            _add(index, folder, file, present[file], names, unread)
            if (number + 1) % _BATCH == 0:
                index.execute("COMMIT")
                index.execute("BEGIN IMMEDIATE")
        index.execute("COMMIT")
    except BaseException:
        if index.in_transaction:
            index.execute("ROLLBACK")
        raise
    return unread


def _present(folder: Path) -> dict[str, tuple[int, int]]:
    """Return each recording of a folder and its subfolders, with its size and date."""
    found: dict[str, tuple[int, int]] = {}
    waiting = [("", str(folder))]
    while waiting:
        prefix, path = waiting.pop()
        try:
            with os.scandir(path) as entries:
                for entry in entries:
                    name = entry.name
                    if name.endswith(".mcap"):
                        found[prefix + name] = _stamp(entry)
                    elif entry.is_dir(follow_symlinks=False):
                        waiting.append((f"{prefix}{name}/", entry.path))
        except OSError:
            continue  # a folder of another user, or one that was just removed
    return found


def _stamp(entry: os.DirEntry[str]) -> tuple[int, int]:
    try:
        found = entry.stat()
    except OSError:
        return (-1, -1)  # a link to nowhere: reading it states why
    return (found.st_size, found.st_mtime_ns)


def _known(index: sqlite3.Connection) -> dict[str, tuple[int, int]]:
    """Return the recordings of the index, with the size and date at which each was read."""
    rows = index.execute("SELECT file, bytes, mtime_ns FROM recordings")
    return {file: (size, mtime_ns) for file, size, mtime_ns in rows}


def _forget(index: sqlite3.Connection, files: Sequence[str]) -> None:
    if not files:
        return
    index.execute("CREATE TEMP TABLE gone(id INTEGER PRIMARY KEY)")
    index.executemany(
        "INSERT INTO gone SELECT id FROM recordings WHERE file = ?", [(file,) for file in files]
    )
    index.execute("DELETE FROM facts WHERE recording IN (SELECT id FROM gone)")
    index.execute("DELETE FROM recordings WHERE id IN (SELECT id FROM gone)")
    index.execute("DROP TABLE gone")


def _add(
    index: sqlite3.Connection,
    folder: Path,
    file: str,
    stamp: tuple[int, int],
    names: dict[str, int],
    unread: list[Unread],
) -> None:
    from rigd.model import RecordingError
    from rigd.record.read.brief import brief_info

    path = folder / file
    try:
        str(path).encode()
    except UnicodeEncodeError:
        shown = os.fsencode(path).decode(errors="backslashreplace")
        error = RecordingError(f"the name {shown} is not UTF-8", hint="Rename the file or folder.")
        unread.append((Path(shown), error))
        return
    try:
        info = brief_info(path)
        line = line_of(info, file)
    except RecordingError as error:
        unread.append((path, error))
        return
    except OSError:
        return  # removed since
    marks = ", ".join("?" * (2 + len(_COLUMNS)))
    columns = ", ".join(_COLUMNS)
    number = index.execute(
        f"INSERT INTO recordings(bytes, mtime_ns, {columns}) VALUES ({marks})",
        (*stamp, *vars(line).values()),
    ).lastrowid
    index.executemany(
        "INSERT INTO facts VALUES (?, ?, ?, ?, ?, ?)",
        [
            (_number_of(index, fact, names), number, place, *fact.value)
            for place, fact in enumerate(facts_of(info, line))
        ],
    )


def _number_of(index: sqlite3.Connection, fact: Fact, names: dict[str, int]) -> int:
    """Return the number of a field; add it if it is new."""
    known = names.get(fact.field)
    if known is None:
        index.execute("INSERT OR IGNORE INTO names(name) VALUES (?)", (fact.field,))
        (known,) = index.execute("SELECT id FROM names WHERE name = ?", (fact.field,)).fetchone()
        names[fact.field] = int(known)
    return int(known)


def lines(index: sqlite3.Connection, where: str, values: Sequence[object]) -> list[Listing]:
    """Return the lines of the recordings for which the SQL ``where`` holds, by file name."""
    columns = ", ".join(_COLUMNS)
    found = index.execute(
        f"SELECT {columns} FROM recordings WHERE {where} ORDER BY file", tuple(values)
    )
    return [Listing(*row) for row in found]
