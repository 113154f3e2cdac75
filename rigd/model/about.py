"""Operator, note and metadata of a run."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

MOST_LETTERS: Final = 200  #: of an operator's name
MOST_NOTE_LETTERS: Final = 2000
MOST_VALUE_LETTERS: Final = 200
MOST_ENTRIES: Final = 32
_KEY: Final = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,39}")
#: Categories of characters that steer a terminal or hide text, or are no text at all.
_NO_TEXT: Final = frozenset({"Cc", "Cs", "Co", "Cn", "Zl", "Zp"})
#: Characters that turn the direction in which everything behind them is read.
_TURNING: Final = frozenset(
    "\u200e\u200f\u061c\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
)


@dataclass(frozen=True)
class About:
    """What was said of a run when it was started, checked."""

    operator: str = ""
    note: str = ""
    meta: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check every text.

        Raises:
            ValueError: one is too long or holds a character that is no text; says which.
        """
        check_text(self.operator, "the operator", MOST_LETTERS)
        check_text(self.note, "the note", MOST_NOTE_LETTERS, lines=True)
        if len(self.meta) > MOST_ENTRIES:
            raise ValueError(f"{len(self.meta)} values are given, at most {MOST_ENTRIES} are kept")
        for key, value in self.meta.items():
            if _KEY.fullmatch(key) is None:
                raise ValueError(
                    f"{plain(key)!r} is no name: it begins with a letter and has at most 40 "
                    "letters, digits, _ and -"
                )
            check_text(value, key, MOST_VALUE_LETTERS)


def check_text(text: str, what: str, most: int, *, lines: bool = False) -> None:
    """Check that a text is short enough and only text; ``lines`` lets it have several lines.

    Raises:
        ValueError: it is not; names ``what``, and the character by its number.
    """
    if len(text) > most:
        raise ValueError(f"{what} has {len(text)} letters, at most {most} are kept")
    for letter in text:
        if not _is_text(letter) and not (lines and letter in "\n\t"):
            raise ValueError(f"{what} holds the character U+{ord(letter):04X}, which is no text")


def visible(text: str) -> str:
    """Return a text of any lines in which each character that is no text stands as its escape."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        letter if _is_text(letter) or letter in "\n\t" else _escaped(letter) for letter in text
    )


def plain(text: str) -> str:
    """Return a text as one line, :func:`visible`."""
    return visible(text).replace("\n", " ").replace("\t", " ")


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape").decode("ascii")


def _is_text(letter: str) -> bool:
    return unicodedata.category(letter) not in _NO_TEXT and letter not in _TURNING
