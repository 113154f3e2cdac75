"""Matches the names of files: `{test}_force.csv`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

#: The files with the same text here belong to one test, and become one recording.
TEST: Final = "test"
_PART: Final = re.compile(r"\{([a-z][a-z0-9_]*)\}|(\*)")


@dataclass(frozen=True)
class Pattern:
    """A pattern of the last parts of a path: `*` is any text, `{name}` one that is kept.

    Neither goes beyond a `/`.

    Raises:
        ValueError: a name stands twice, or a brace has no name.
    """

    text: str

    def __post_init__(self) -> None:
        names = self.fields
        if len(set(names)) < len(names):
            raise ValueError(f"a name stands twice in {self.text!r}")
        if re.search(r"[{}]", _PART.sub("", self.text)):
            raise ValueError(f"the braces in {self.text!r} hold no name such as {{test}}")

    @property
    def fields(self) -> list[str]:
        """The names in braces."""
        return [match[1] for match in _PART.finditer(self.text) if match[1]]

    def match(self, path: Path) -> Mapping[str, str] | None:
        """Return the texts that the names stand for, or None if ``path`` is not meant."""
        count = len(Path(self.text).parts)
        tail = "/".join(path.absolute().parts[-count:])
        found = self._expression.fullmatch(tail)
        return None if found is None else found.groupdict()

    def root(self, path: Path) -> Path:
        """Return the folder at which the pattern begins, if it matches ``path``."""
        return path.absolute().parents[len(Path(self.text).parts) - 1]

    def filled(self, texts: Mapping[str, str]) -> str | None:
        """Return the name with its braces replaced by ``texts``; None if one is not known."""
        if any(name not in texts for name in self.fields) or "*" in self.text:
            return None
        return _PART.sub(lambda match: texts[match[1]], self.text)

    @cached_property
    def _expression(self) -> re.Pattern[str]:
        parts, at = [], 0
        for match in _PART.finditer(self.text):
            parts.append(re.escape(self.text[at : match.start()]))
            parts.append(f"(?P<{match[1]}>[^/]+?)" if match[1] else "[^/]*")
            at = match.end()
        return re.compile("".join([*parts, re.escape(self.text[at:])]))
