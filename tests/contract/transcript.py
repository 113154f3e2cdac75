"""Commands and what they print, as text that is the same on each day, in each folder.

What a day, a folder, a machine or a commit gives a text is replaced by a word.
"""

from __future__ import annotations

import os
import re
import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from contract.recording_text import short, text_of
from support.commands.command import rigd

ROOT: Final = Path(__file__).resolve().parents[2]

#: What changes from day to day or from commit to commit, and its word.
_CHANGES: Final = (
    (re.compile(r"[0-9a-f]{64}"), "SHA256"),
    (re.compile(r"\b[0-9a-f]{12}(-dirty)?\b(?=[^0-9a-f])"), "REVISION"),
    (re.compile(r"\b20(2[6-9]|[3-9]\d)-\d\d-\d\d([ T]\d\d:\d\d(:\d\d(\.\d+)?)?)?( UTC|Z|\+00:00)?"),
     "DATE"),
    (re.compile(r"\b(?!20261121-080000)20\d{6}-\d{6}\b"), "STAMP"),  # that of examples stays
    (re.compile(r'"bytes": \d+'), '"bytes": SIZE'),
    (re.compile(r"\b\d+(\.\d+)? [kMG]?B\b"), "SIZE"),
    (re.compile(r"\b\d+ bytes\b"), "SIZE"),
    (re.compile(r"^rigd: compiles its functions, once after an installation.*\n", re.M), ""),
)  # fmt: skip
_SVG: Final = re.compile(r"<svg\b.*?</svg>", re.S)


@dataclass
class Transcript:
    """Plays commands in a folder and keeps what they print, their exit codes, and their files."""

    folder: Path
    lines: list[str] = field(default_factory=list)

    def play(self, command: str, *, keep: str | None = None, quiet: bool = False) -> int:
        """Play a command as a user types it, without its `rigd`; return its exit code.

        ``keep`` is the file that takes its standard output, in place of the text; with ``quiet``
        standard output stands in the text as a digest.
        """
        ended = rigd(*self._words(command), cwd=self.folder)
        if keep is not None:
            (self.folder / keep).write_text(ended.out, "utf-8")
        self.lines += [f"$ rigd {command}" + (f" > {keep}" if keep else "")]
        out = self.plain(ended.out)
        if quiet:
            out = f"digest {short(out.encode())}\n"
        self.lines += [f"exit code {ended.code}", out if keep is None else ""]
        if ended.err:
            self.lines += ["on standard error:", self.plain(ended.err)]
        return ended.code

    def files(self) -> None:
        """Add each file of the folder: a recording as its text, a page without its drawings."""
        for path in sorted(path for path in self.folder.rglob("*") if path.is_file()):
            self.lines += [f"--- {path.relative_to(self.folder)}"]
            match path.suffix:
                case ".mcap":
                    self.lines += [self.plain(text_of(path))]
                case ".html":
                    self.lines += [self.plain(_without_drawings(path.read_text("utf-8")))]
                case ".json" | ".yaml" | ".csv" | ".xml" | ".txt":
                    self.lines += [self.plain(path.read_text("utf-8"))]
                case _:
                    pass

    @property
    def text(self) -> str:
        """All of it."""
        return "\n".join(line.rstrip("\n") for line in self.lines) + "\n"

    def plain(self, text: str) -> str:
        """Return a text without what day, folder and commit give it."""
        text = text.replace(str(self.folder), "FOLDER").replace(str(ROOT), "RIGD")
        for pattern, word in _CHANGES:
            text = pattern.sub(word, text)
        return text

    def _words(self, command: str) -> list[str]:
        words: list[str] = []
        for word in shlex.split(command):
            found = sorted(self.folder.glob(word)) if "*" in word else []
            words += [os.fspath(path.relative_to(self.folder)) for path in found] or [word]
        return words


def _without_drawings(page: str) -> str:
    return _SVG.sub(lambda match: f"<svg {short(match[0].encode())}>", page)
