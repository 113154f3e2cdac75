"""Loads a procedure file and checks its keys and shapes; does not need the rig."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from rigd.config.binding import bind
from rigd.config.document import Document, parse_document, read_document
from rigd.config.problems import Problems
from rigd.config.rig import SourceFile
from rigd.config.shipped_files import find_file, location
from rigd.model.errors import ConfigError
from rigd.procedure.source import ProcedureSource


@dataclass(frozen=True)
class Procedure:
    """Holds a procedure as written, with the line and column of every value."""

    source: ProcedureSource
    document: Document
    location: str = ""

    @property
    def name(self) -> str:
        """The name in the file."""
        return self.source.procedure

    @property
    def file(self) -> SourceFile:
        """The file as its author wrote it, for the recording."""
        return SourceFile(self.document.path, self.document.text, self.location)


def load_procedure(given: str | Path, recorded: bytes | None = None) -> Procedure:
    """Return the procedure of a file, or of a procedure's name (see :func:`find_file`).

    Raises:
        ConfigError: the file is missing or wrong; the error names every problem with its place.
    """
    found = find_file(given, "procedures", recorded)
    return replace(_bind(read_document(found)), location=location(given, found, "procedures"))


def load_own_procedure(path: str | Path) -> Procedure:
    """Return the procedure of the file ``path``: no shipped file in its place moves another rig.

    Raises:
        ConfigError: the file is missing or wrong; the error names every problem with its place.
    """
    if not Path(path).is_file():
        name = Path(path).stem
        raise ConfigError(
            f"file {str(path)!r} does not exist below {Path.cwd()}",
            hint=f"to use the procedure that the daemon has, give its name: {name}",
        )
    return load_procedure(path)


def parse_procedure(text: str, path: Path) -> Procedure:
    """Return the procedure in ``text``, such as the text attached to a recording.

    ``path`` is the name in error messages.

    Raises:
        ConfigError: the text is wrong; the error names every problem with its place.
    """
    return _bind(parse_document(text, path))


def _bind(document: Document) -> Procedure:
    document.check_kind("procedure")
    problems = Problems()
    source = bind(document, ProcedureSource, problems)
    problems.raise_any()
    if source is None:
        raise ConfigError("the procedure file cannot be used", place=document.place(()))
    return Procedure(source, document)
