"""Escapes control characters in output, so that foreign text cannot control the terminal.

Foreign text is text that rigd did not write. Its characters cannot change the direction of a line.
"""

from __future__ import annotations

import re
import sys
from codecs import register_error
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import TextIOWrapper
from typing import Any, Final, TextIO, cast

from rigd.model.about import visible

#: Control sequences that the progress bars and colours of rich write: colours, a line up, a line
#: erased, the cursor.
_OWN: Final = re.compile(r"(\x1b\[[0-9;]*[mAK]|\x1b\[\?25[hl]|\r)")

#: The name of :func:`_replaced`.
_LACKING: Final = "rigd.lacking"


def _replaced(error: UnicodeError) -> tuple[str, int]:
    """Return what stands for letters that an encoding lacks: a hyphen for a minus, or escapes."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end].replace("−", "-")
    return text.encode(error.encoding, "backslashreplace").decode(error.encoding), error.end


register_error(_LACKING, _replaced)


class Screen:
    """A stream that shows control and direction characters as escapes."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write a text."""
        own, parts = False, []
        for part in _OWN.split(text):
            parts.append(part if own else visible(part))
            own = not own
        self._stream.write("".join(parts))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write texts."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        """Return another attribute of the stream."""
        return getattr(self._stream, name)


@contextmanager
def screened() -> Iterator[None]:
    """Replace both standard streams by screens while the context is active."""
    before = sys.stdout, sys.stderr
    for stream in before:
        # A pipe on Windows has 256 characters, without most Greek letters.
        if isinstance(stream, TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors=_LACKING)
    sys.stdout, sys.stderr = (cast(TextIO, Screen(stream)) for stream in before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before
