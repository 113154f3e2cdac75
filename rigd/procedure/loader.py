"""Loads a procedure file: checks keys and shapes; the rig is not known yet."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from rigd.config.binding import bind
from rigd.config.document import Document, parse_document, read_document
from rigd.config.problems import Problems
from rigd.config.rig import SourceFile
from rigd.config.shipped import find_file, whence
from rigd.model.errors import ConfigError
from rigd.procedure.source import ProcedureSource


@dataclass(frozen=True)
class Procedure:
    """A procedure as written, with the place of everything in it."""

    source: ProcedureSource
    document: Document
    whence: str = ""

    @property
    def name(self) -> str:
        """The name in the file."""
        return self.source.procedure

    @property
    def file(self) -> SourceFile:
        """The file as its author wrote it, for the recording."""
        return SourceFile(self.document.path, self.document.text, self.whence)


def load_procedure(given: str | Path) -> Procedure:
    """Return the procedure of a file, or of a procedure's name (see :func:`find_file`).

    Raises:
        ConfigError: there is no such file, or it is wrong; names every problem with its place.
    """
    found = find_file(given, "procedures")
    return replace(_bind(read_document(found)), whence=whence(given, found, "procedures"))


def parse_procedure(text: str, path: Path) -> Procedure:
    """Return the procedure that ``text`` describes, such as one attached to a recording.

    ``path`` is the name that errors give.

    Raises:
        ConfigError: the text is wrong; names every problem with its place.
    """
    return _bind(parse_document(text, path))


def _bind(document: Document) -> Procedure:
    problems = Problems()
    source = bind(document, ProcedureSource, problems)
    problems.raise_any()
    if source is None:
        raise ConfigError("the procedure file cannot be used", place=document.place(()))
    return Procedure(source, document)
