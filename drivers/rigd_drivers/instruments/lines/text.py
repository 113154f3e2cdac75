r"""Converts text of a rig file with escapes such as \r\n to the bytes that are sent."""

from __future__ import annotations

import re
from typing import Any, Final

_ESCAPE: Final = re.compile(r"\\(x[0-9A-Fa-f]{2}|.|$)")
_NAMED: Final = {"r": "\r", "n": "\n", "t": "\t", "e": "\x1b", "0": "\0", "\\": "\\"}


def encoded(text: str) -> bytes:
    r"""Return the bytes of ``text``; the escapes are ``\r \n \t \e \0 \xHH`` and ``\\``.

    Raises:
        ValueError: an escape is unknown, or a character is not ASCII.

    """
    if not text.isascii():
        wrong = next(item for item in text if not item.isascii())
        raise ValueError(f"{wrong!r} in {text!r} is not ASCII: write its bytes as \\xHH")

    def byte(match: re.Match[str]) -> str:
        name = match[1]
        if name.startswith("x") and len(name) == 3:
            return chr(int(name[1:], 16))
        if name not in _NAMED:
            raise ValueError(
                f"'\\{name}' in {text!r} is no escape: known are \\r, \\n, \\t, \\e, \\0, \\xHH "
                "and \\\\"
            )
        return _NAMED[name]

    return _ESCAPE.sub(byte, text).encode("latin-1")


def commands(value: Any) -> Any:
    """Return a single command as a list of one."""
    return [value] if isinstance(value, str) else value
