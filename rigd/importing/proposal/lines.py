"""Holds lines of a proposed map: a key, its value, and what is to be filled in."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from rigd.importing.map.blanks import BLANK

_PLAIN: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*( [A-Za-z0-9_]+)*")
#: What YAML may take for more than a word.
_NO_WORDS: Final = ("true", "false", "null", "yes", "no", "on", "off")
_LONGEST: Final = 300


@dataclass
class MapLine:
    """``key: value  # note``; ``asks``: the value is a guess, and the user shall fill in it."""

    key: str
    value: str
    note: str = ""
    asks: bool = False

    def item(self, *, guess: bool) -> str:
        """Return key and value; ``guess``: also where it is to be filled in."""
        return f"{self.key}: {self.value if guess or not self.asks else quoted(BLANK)}"

    @property
    def comment(self) -> str:
        """The note, as a comment at the end of a line."""
        return comment(f"to fill in: {self.note}" if self.asks else self.note)


def comment(text: str) -> str:
    """Return ``text`` as a comment behind a value, "" if there is none."""
    words = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    words = words if len(words) <= _LONGEST else f"{words[:_LONGEST]}…"
    return f"  # {words}" if words else ""


def quoted(text: str) -> str:
    """Return ``text`` as a value of YAML."""
    if _PLAIN.fullmatch(text) and text.lower() not in _NO_WORDS:
        return text
    return json.dumps(text, ensure_ascii=False)


def block(lines: Sequence[MapLine], indent: str, *, guess: bool) -> list[str]:
    """Return lines of a block of YAML."""
    return [f"{indent}{line.item(guess=guess)}{line.comment}" for line in lines]
