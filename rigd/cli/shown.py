"""What commands print: text that is not rigd's own can neither steer a terminal nor turn a line."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Final, TextIO, cast

from rigd.model.about import visible

#: What the progress bars and colours of rich write: colours, a line up, a line erased, the cursor.
_OWN: Final = re.compile(r"(\x1b\[[0-9;]*[mAK]|\x1b\[\?25[hl]|\r)")


class Screen:
    """A stream that shows what would steer or turn as an escape."""

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
        """Return the rest of the stream."""
        return getattr(self._stream, name)


@contextmanager
def screened() -> Iterator[None]:
    """Let both standard streams be screens meanwhile."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (cast(TextIO, Screen(stream)) for stream in before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before
