"""Checks the operator, the note, the specimen and the metadata that a person gives for a run."""

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
#: The name of a specimen is the name of its file too.
SPECIMEN_NAME: Final = r"[A-Za-z0-9][A-Za-z0-9._-]{0,59}"
_SPECIMEN: Final = re.compile(SPECIMEN_NAME)
#: Categories of characters that control a terminal, hide text, or are not text.
_NO_TEXT: Final = frozenset({"Cc", "Cs", "Co", "Cn", "Zl", "Zp"})
#: Characters that change the direction in which the following text is read.
_TURNING: Final = frozenset(
    "\u200e\u200f\u061c\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
)


@dataclass(frozen=True)
class About:
    """Holds what is stated at the start of a run, after a check: a specimen by its name."""

    operator: str = ""
    note: str = ""
    meta: Mapping[str, str] = field(default_factory=dict)
    specimen: str = ""

    def __post_init__(self) -> None:
        """Check every text.

        Raises:
            ValueError: a text is too long or contains a control character; the message names it.
        """
        check_text(self.operator, "the operator", MOST_LETTERS)
        check_text(self.note, "the note", MOST_NOTE_LETTERS, lines=True)
        if self.specimen and _SPECIMEN.fullmatch(self.specimen) is None:
            raise ValueError(
                f"{plain(self.specimen)!r} is not the name of a specimen: it begins with a letter "
                "or a digit and has at most 60 letters, digits, '_', '-' and '.'"
            )
        if len(self.meta) > MOST_ENTRIES:
            raise ValueError(
                f"{len(self.meta)} values are given, at most {MOST_ENTRIES} are allowed"
            )
        for key, value in self.meta.items():
            if _KEY.fullmatch(key) is None:
                raise ValueError(
                    f"{plain(key)!r} is not a name: it begins with a letter and has at most "
                    "40 letters, digits, _ and -"
                )
            check_text(value, key, MOST_VALUE_LETTERS)


def check_text(text: str, name: str, most: int, *, lines: bool = False) -> None:
    """Check that a text is short and has no control characters; ``lines`` allows several lines.

    Raises:
        ValueError: it is not; names ``name``, and the character by its number.
    """
    if len(text) > most:
        raise ValueError(f"{name} has {len(text)} letters, at most {most} are allowed")
    for letter in text:
        if not _is_text(letter) and not (lines and letter in "\n\t"):
            raise ValueError(f"{name} contains the control character U+{ord(letter):04X}")


def visible(text: str) -> str:
    """Return a text in which every control character is replaced by its escape; line ends stay."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        letter if _is_text(letter) or letter in "\n\t" else _escaped(letter) for letter in text
    )


def plain(text: str) -> str:
    """Return a text as one line, with :func:`visible`."""
    return visible(text).replace("\n", " ").replace("\t", " ")


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape").decode("ascii")


def _is_text(letter: str) -> bool:
    return unicodedata.category(letter) not in _NO_TEXT and letter not in _TURNING
