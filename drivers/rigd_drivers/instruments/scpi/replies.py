"""Reads the answers of instruments: numbers and entries of the error queue.

Source: SCPI-1999, volume 1, 7.2.1 (numbers that are none) and 21.8 (the error queue).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

_NUMBER: Final = re.compile(r"[-+]? *(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?", re.ASCII)
_ERROR: Final = re.compile(r"(?P<code>[-+]?\d{1,6})(?:\s*,\s*(?P<text>.*))?", re.ASCII | re.DOTALL)
#: Larger numbers mean infinity (9.9E37) or not a number (9.91E37).
LARGEST: Final = 9.8e37
_WORDS: Final = frozenset({"nan", "inf", "+inf", "-inf", "ninf", "infinity"})


@dataclass(frozen=True)
class Entry:
    """An entry of the error queue; ``code`` 0: there is none."""

    code: int
    text: str = ""

    def __str__(self) -> str:
        """Return the entry as the instrument gives it."""
        return f"{self.code} {self.text!r}" if self.text else str(self.code)


def read_number(answer: str) -> float | None:
    """Return the number in ``answer``; NaN for one that means none, None if it is no number."""
    text = answer.strip()
    if text.casefold() in _WORDS:
        return math.nan
    if _NUMBER.fullmatch(text) is None:
        return None
    value = float(text.replace(" ", ""))
    return math.nan if abs(value) >= LARGEST else value


def read_entry(answer: str) -> Entry | None:
    """Return the entry of the error queue in ``answer``; None if it is none."""
    match = _ERROR.fullmatch(answer.strip())
    if match is None:
        return None
    return Entry(int(match["code"]), (match["text"] or "").strip().strip("\"'"))
