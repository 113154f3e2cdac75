"""Keeps the pages of comparisons in memory, and gives them to clients in pieces."""

from __future__ import annotations

import base64
import hashlib
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from rigd.daemon.serve.worker import CalculationWorker
from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.results import PieceView

#: So many pages are kept, the newest: a transfer needs its page for each piece.
KEPT: Final = 8
#: A larger page is refused, in bytes.
MOST_BYTES: Final = 16 * 1024 * 1024
#: The state of a recording: its name, size in bytes, and time of change in ns.
_State = tuple[str, int, int]


class ComparedPages:
    """The pages of comparisons, which ``worker`` makes; nothing is written to the recordings.

    Used by the thread of one lane.
    """

    def __init__(self, worker: CalculationWorker) -> None:
        self._worker = worker
        self._pages: OrderedDict[tuple[_State, ...], bytes] = OrderedDict()

    def piece(self, recordings: Sequence[Path], offset: int, length: int) -> PieceView:
        """Return a piece of the page; it is made if there is none, or a recording has changed.

        Raises:
            Refusal: the recordings cannot be compared, or ``offset`` is beyond the end.
        """
        page = self._page(recordings)
        if offset > len(page):
            raise Refusal(Code.BAD_REQUEST, f"the page has {len(page)} bytes, none at {offset}")
        return PieceView(
            size=len(page),
            sha256=hashlib.sha256(page).hexdigest(),
            offset=offset,
            data=base64.b64encode(page[offset : offset + length]),
        )

    def _page(self, recordings: Sequence[Path]) -> bytes:
        key = tuple(map(_state, recordings))
        if key not in self._pages:
            page = self._worker.compare(recordings).encode()
            if len(page) > MOST_BYTES:
                raise Refusal(
                    Code.REFUSED,
                    f"the page has {len(page)} bytes, at most {MOST_BYTES} are sent",
                    hint="compare fewer recordings",
                )
            self._pages[key] = page
            if len(self._pages) > KEPT:
                self._pages.popitem(last=False)
        self._pages.move_to_end(key)
        return self._pages[key]


def _state(path: Path) -> _State:
    try:
        found = path.stat()
    except OSError as error:
        raise Refusal(Code.REFUSED, f"{path.name} cannot be read: {error.strerror}") from error
    return path.name, found.st_size, found.st_mtime_ns
