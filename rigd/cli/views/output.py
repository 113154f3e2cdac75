"""The one way of all output of a command: escapes control characters, and survives a lost stream.

Foreign text is text that rigd did not write. Its characters cannot control the terminal or change
the direction of a line. A stream is lost if its terminal, pipe or file accepts nothing more: it is
closed, or its disk is full. What cannot be shown is not shown: no run ends for it.
"""

from __future__ import annotations

import os
import re
import sys
from codecs import register_error
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from pathlib import Path
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


class OutputLost(OSError):
    """Standard output is lost: its reader has gone, or its disk is full; ``why`` is the cause."""

    def __init__(self, why: OSError | None = None) -> None:
        super().__init__(str(why))
        self.why = why

    @property
    def unread(self) -> bool:
        """Whether nobody reads it (``rigd runs | head``): then nothing is wrong."""
        return isinstance(self.why, BrokenPipeError)


class Screen:
    """A stream that shows control and direction characters as escapes.

    A ``stream`` that is None, or is lost, takes all that is written and shows nothing. If
    ``ends`` is true, the loss of a stream is raised once.

    Raises:
        OutputLost: from each method that writes, see above.
    """

    def __init__(self, stream: TextIO | None, *, ends: bool = False) -> None:
        self._stream = _nowhere() if stream is None else stream
        self.ends = ends

    def flush(self) -> None:
        """Write what waits."""
        try:
            self._stream.flush()
        except OSError as error:
            self._lose(error)
        except ValueError:  # closed
            self._lose(None)

    def _lose(self, why: OSError | None) -> None:
        lost, self._stream = self._stream, _nowhere()
        with suppress(OSError, ValueError):  # what it still holds is written when Python ends
            os.dup2(self._stream.fileno(), lost.fileno())
        if self.ends:
            raise OutputLost(why)

    def write(self, text: str) -> int:
        """Write a text."""
        own, parts = False, []
        for part in _OWN.split(text):
            parts.append(part if own else visible(part))
            own = not own
        try:
            self._stream.write("".join(parts))
        except OSError as error:
            self._lose(error)
        except ValueError:
            if not self._stream.closed:
                raise
            self._lose(None)
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write texts."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        """Return another attribute of the stream."""
        return getattr(self._stream, name)


def _nowhere() -> TextIO:
    """Return a stream that discards what is written."""
    return Path(os.devnull).open("w", encoding="utf-8")


def outlive_output() -> None:
    """Let this command go on if its output is lost: it moves a rig, or serves one."""
    if isinstance(sys.stdout, Screen):
        sys.stdout.ends = False


@contextmanager
def screened() -> Iterator[None]:
    """Replace both standard streams by screens while the context is active.

    Raises:
        OutputLost: standard output is lost, and the command does not outlive it.
    """
    before = sys.stdout, sys.stderr
    for stream in before:
        # A pipe on Windows has 256 characters, without most Greek letters.
        if isinstance(stream, TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors=_LACKING)
    out, err = Screen(before[0], ends=True), Screen(before[1])
    sys.stdout, sys.stderr = cast(TextIO, out), cast(TextIO, err)
    try:
        yield
    finally:
        try:
            out.flush()
        finally:
            err.flush()
            sys.stdout, sys.stderr = before
