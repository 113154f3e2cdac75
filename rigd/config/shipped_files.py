"""Finds a rig or procedure by path or name: the current folder first, then shipped files."""

from __future__ import annotations

import re
from codecs import BOM_UTF8
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from rigd.config.problems import suggest
from rigd.model.errors import ConfigError
from rigd.sdk.shipped_files import Kind, shipped_folder

_KEYS: Final = {"configs": "rig", "maps": "map", "procedures": "procedure"}


def is_path(given: str | Path) -> bool:
    """Return whether ``given`` is a path, and not the name of a rig or a procedure."""
    return isinstance(given, Path) or "/" in given or given.endswith((".yaml", ".yml"))


def find_file(given: str | Path, kind: Kind, recorded: bytes | None = None) -> Path:
    """Return the file that ``given`` means: a path, or the name inside a file.

    A path means exactly that file, with one exception: ``procedures/quick.yaml``, as in the
    documentation, is the shipped file if the current folder has no ``procedures``. If two files of
    one folder have the name, the one with the text ``recorded`` is meant.

    Raises:
        ConfigError: the file is missing, or two files of one folder have the name.
    """
    path = Path(given)
    shipped = shipped_folder(kind)
    if path.is_file():
        return path
    documented = str(given) == f"{kind}/{path.name}" and not Path(kind).exists()
    if documented and (shipped / path.name).is_file():
        return shipped / path.name
    names: set[str] = set()
    if not is_path(given):
        for folder in (Path(), Path(kind), shipped):
            found = {file: name for file, name in _named_files(folder, kind)}
            names.update(found.values())
            matches = [file for file, name in found.items() if str(given) in (name, file.stem)]
            if len(matches) > 1:
                matches = [file for file in matches if _text(file) == recorded][:1] or matches
            if len(matches) > 1:
                both = " and ".join(map(str, matches))
                raise ConfigError(f"{given!s} could be {both}", hint="give the path of the file")
            if matches:
                return matches[0]
    else:
        for file, name in _named_files(shipped, kind):
            names.update((file.stem, name))
        if path.stem in names:
            raise ConfigError(
                f"file {str(given)!r} does not exist below {Path.cwd()}",
                hint=(f"to use the shipped {_KEYS.get(kind, 'file')}, give its name: {path.stem}"),
            )
    raise ConfigError(
        f"{_KEYS.get(kind, 'file')} {str(given)!r} is neither below {Path.cwd()} nor among "
        "the shipped files",
        hint=suggest(path.stem, names),
    )


def _text(file: Path) -> bytes:
    """Return the text of a file as a recording has it."""
    return file.read_bytes().removeprefix(BOM_UTF8)


def find_beside(name: str, folder: Path) -> Path:
    """Return the path of the file ``name`` that a rig file in ``folder`` names, also if missing.

    A relative path starts at the folder; if the file is not there, a shipped file may be meant.
    """
    own_path = folder / name
    shipped = shipped_folder("configs") / name
    return shipped if shipped.is_file() and not own_path.exists() else own_path


def location(given: str | Path, found: Path, kind: Kind) -> str:
    """Return a description of the place where the file ``given`` was found.

    ``found`` is the result of :func:`find_file`. The description of a file in the current folder
    with the name of a shipped file mentions it: the two files may differ.
    """
    shipped = shipped_folder(kind)
    if found.resolve().is_relative_to(shipped):
        return "shipped"
    if Path(given) == found:
        return str(found)
    names = (name for file, text in _named_files(shipped, kind) for name in (file.stem, text))
    instead = f", instead of the shipped {_KEYS.get(kind, 'file')}" if str(given) in names else ""
    return f"./{found}{instead}"


def titled(name: str, location: str) -> str:
    """Return ``name``, which is from a file, with the location of that file if it is known."""
    return f"{name} ({location})" if location else name


def _named_files(folder: Path, kind: Kind) -> Iterator[tuple[Path, str]]:
    """Yield the files of ``folder`` that state their kind, with the name that they give."""
    pattern = re.compile(rf"^{_KEYS.get(kind, kind)}:[ \t]*[\"']?([A-Za-z0-9_-]+)", re.MULTILINE)
    for file in sorted(item for item in folder.glob("*.yaml") if item.is_file()):
        try:
            text = file.read_text(encoding="utf-8-sig", errors="replace")
        except OSError:
            continue  # an unreadable file has no name; its path reports the error
        match = pattern.search(text)
        if match:
            yield file, match[1]
