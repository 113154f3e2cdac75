"""The index follows the files, is made again from them, and is never needed."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from rigd.catalogue import Found, index, search
from rigd.model import RecordingError


def names(found: Found) -> list[str]:
    return [line.file for line in found.lines]


@pytest.fixture
def own(folder: Path, tmp_path: Path) -> Path:
    """Two of the recordings, to be changed."""
    mine = tmp_path / "mine"
    mine.mkdir()
    for name in ("a.mcap", "b.mcap"):
        shutil.copy2(folder / name, mine)
    return mine


def test_known_recordings_are_not_read_again(own: Path, cache: Path) -> None:
    path, before = own / "a.mcap", (own / "a.mcap").stat()
    assert names(search(own)) == ["a.mcap", "b.mcap"]
    path.write_bytes(b"x" * before.st_size)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert names(search(own)) == ["a.mcap", "b.mcap"]
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns + 1))
    found = search(own)
    assert names(found) == ["b.mcap"]
    assert [broken.path for broken in found.broken] == [path]


def test_new_moved_and_deleted_recordings_are_noticed(
    own: Path, cache: Path, write: Callable[..., None]
) -> None:
    search(own)
    write(own / "deep" / "new.mcap", {})
    (own / "a.mcap").rename(own / "c.mcap")
    (own / "b.mcap").unlink()
    assert names(search(own)) == ["c.mcap", "deep/new.mcap"]
    shutil.rmtree(own / "deep")
    assert names(search(own)) == ["c.mcap"]


def spoil_bytes(path: Path) -> None:
    path.write_bytes(b"no database at all" * 100)


def spoil_pages(path: Path) -> None:
    content = path.read_bytes()
    path.write_bytes(content[:4096] + b"\xff" * (len(content) - 4096))


def spoil_version(path: Path) -> None:
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA user_version = 7")
        database.execute("DROP TABLE names")


def spoil_tables(path: Path) -> None:
    with closing(sqlite3.connect(path)) as database:
        database.execute("DROP TABLE recordings")


@pytest.mark.parametrize("spoil", [spoil_bytes, spoil_pages, spoil_version, spoil_tables])
def test_a_spoilt_index_is_made_again(
    own: Path, cache: Path, spoil: Callable[[Path], None]
) -> None:
    search(own)
    path = index.index_path(own)
    spoil(path)
    assert names(search(own)) == ["a.mcap", "b.mcap"]
    with closing(sqlite3.connect(path)) as database:
        assert database.execute("SELECT count(*) FROM recordings").fetchone() == (2,)


def test_without_a_place_nothing_is_missing(
    own: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert names(search(own)) == ["a.mcap", "b.mcap"]


def test_an_index_in_use_is_not_needed(
    own: Path, cache: Path, monkeypatch: pytest.MonkeyPatch, write: Callable[..., None]
) -> None:
    search(own)
    write(own / "new.mcap", {})
    monkeypatch.setattr(index, "_WAIT_S", 0.0)
    with closing(sqlite3.connect(index.index_path(own))) as other:
        other.execute("BEGIN EXCLUSIVE")
        assert names(search(own)) == ["a.mcap", "b.mcap", "new.mcap"]
    assert names(search(own)) == ["a.mcap", "b.mcap", "new.mcap"]


def test_nothing_is_written_beside_the_recordings(own: Path, cache: Path) -> None:
    before = sorted(own.iterdir())
    search(own)
    assert sorted(own.iterdir()) == before
    assert len(list(cache.rglob("*.sqlite"))) == 1


def test_files_that_are_no_recordings_are_named(own: Path, cache: Path) -> None:
    (own / "empty.mcap").touch()
    (own / "nowhere.mcap").symlink_to(own / "gone")
    (own / "folder.mcap").mkdir()
    os.mkfifo(own / "pipe.mcap")
    found = search(own)
    assert names(found) == ["a.mcap", "b.mcap"]
    assert {broken.path.stem for broken in found.broken} == {"empty", "nowhere", "folder", "pipe"}
    with pytest.raises(RecordingError, match="no folder"):
        search(own / "none")


def test_file_name_not_utf8_hides_no_other(own: Path, cache: Path) -> None:
    try:
        shutil.copy2(own / "a.mcap", own / os.fsdecode(b"messung_\xe4.mcap"))
    except OSError:
        pytest.skip("this file system takes names in UTF-8 only")
    found = search(own)
    assert names(found) == ["a.mcap", "b.mcap"]
    (broken,) = found.broken
    assert broken.path.name == r"messung_\xe4.mcap"
    assert str(broken.problem).startswith(f"the name {broken.path} is not UTF-8")
