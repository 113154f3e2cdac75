"""Retries operations that must not fail for lack of a file descriptor."""

from __future__ import annotations

import errno
import time
from collections.abc import Callable
from typing import Final, TypeVar

T = TypeVar("T")

#: A daemon that unauthenticated connections fill up has room again within a fraction of a second
#: (rigd.daemon.serve.descriptors).
PATIENCE_S: Final = 5.0
_AGAIN_S: Final = 0.02
#: This process, or the whole machine, has none left.
NONE_LEFT: Final = (errno.EMFILE, errno.ENFILE)


def insist(act: Callable[[], T], patience_s: float = PATIENCE_S) -> T:
    """Return what ``act`` returns; called again for a while as long as no descriptor is left.

    ``act`` must be such that it can be begun anew where it could not open something.
    """
    give_up_s = time.monotonic() + patience_s
    while True:
        try:
            return act()
        except Exception as error:
            if not _for_want_of_one(error) or time.monotonic() > give_up_s:
                raise
        time.sleep(_AGAIN_S)


def _for_want_of_one(error: BaseException | None) -> bool:
    """Return whether ``error``, or what caused it, is that none was left."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in NONE_LEFT:
            return True
        error = error.__cause__
    return False
