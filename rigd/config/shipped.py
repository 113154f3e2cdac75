"""Finds a rig or procedure by path or name: the current folder first, then shipped files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from rigd.config.problems import suggest
from rigd.model.errors import ConfigError
from rigd.sdk.shipped import Kind, shipped_folder

_KEYS: Final = {"configs": "rig", "procedures": "procedure"}
_HEAD_BYTES: Final = 4096  # the name stands near the top of a file


def is_path(given: str | Path) -> bool:
    """Return whether ``given`` is a path, and not the name of a rig or a procedure."""
    return isinstance(given, Path) or "/" in given or given.endswith((".yaml", ".yml"))


def find_file(given: str | Path, kind: Kind) -> Path:
    """Return the file that ``given`` means: a path, or a name as it stands in the file.

    A path means that file and no other. Only ``procedures/quick.yaml``, as the documentation
    writes it, is the shipped one where the current folder has no ``procedures``.

    Raises:
        ConfigError: there is no such file, or the name stands in two files of one folder.
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
                both = " and ".join(map(str, matches))
                raise ConfigError(f"{given!s} could be {both}", hint="give the path of one")
            if matches:
                return matches[0]
    else:
        for file, name in _named_files(shipped, kind):
            names.update((file.stem, name))
        if path.stem in names:
            raise ConfigError(
                f"there is no file {str(given)!r} below {Path.cwd()}",
                hint=f"the shipped {_KEYS.get(kind, 'file')} is meant by its name: {path.stem}",
            )
    raise ConfigError(
        f"there is no {_KEYS.get(kind, 'file')} {str(given)!r}, neither below {Path.cwd()} "
        f"nor among the shipped ones",
        hint=suggest(path.stem, names),
    )


def whence(given: str | Path, found: Path, kind: Kind) -> str:
    """Return where the file that ``given`` means was taken from, as a person reads it.

    ``found`` is what :func:`find_file` returned. A file of the current folder that was found by
    the name of a shipped one says so: the two may differ in everything but the name.
    """
    shipped = shipped_folder(kind)
    if found.resolve().is_relative_to(shipped):
        return "shipped"
    if Path(given) == found:
        return str(found)
    names = (name for file, text in _named_files(shipped, kind) for name in (file.stem, text))
    instead = f", instead of the shipped {_KEYS.get(kind, 'file')}" if str(given) in names else ""
    return f"./{found}{instead}"


def titled(name: str, whence: str) -> str:
    """Return ``name``, which a file gives, with where that was taken from, if that is known."""
    return f"{name} ({whence})" if whence else name


def _named_files(folder: Path, kind: Kind) -> Iterator[tuple[Path, str]]:
    """Yield the files of ``folder`` that say what they are, with the name they give."""
    pattern = re.compile(rf"^{_KEYS.get(kind, kind)}:[ \t]*([A-Za-z0-9_-]+)", re.MULTILINE)
    for file in sorted(folder.glob("*.yaml")):
        try:
            with file.open("rb") as stream:
                head = stream.read(_HEAD_BYTES).decode("utf-8", errors="replace")
        except OSError:
            continue  # what cannot be read cannot be meant by name; its path still reports why
        match = pattern.search(head)
        if match:
            yield file, match[1]
