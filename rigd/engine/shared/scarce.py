"""Repeats an operation for some seconds if it fails because no file descriptor is free.

A process, or the whole machine, can be out of file descriptors for a moment. Operations that must
not fail for this reason, such as making a device safe, use :func:`insist`.
"""

from __future__ import annotations

import errno
import time
from collections.abc import Callable
from typing import Final, TypeVar

T = TypeVar("T")

#: For so long, in s.
PATIENCE_S: Final = 5.0
_AGAIN_S: Final = 0.02
#: No descriptor is free in this process, or in the whole machine.
NO_DESCRIPTOR: Final = (errno.EMFILE, errno.ENFILE)


def insist(act: Callable[[], T], patience_s: float = PATIENCE_S) -> T:
    """Return the result of ``act``; call it again for a while if no descriptor is free.

    It must be safe to call ``act`` again after it failed to open something.
    """
    give_up_s = time.monotonic() + patience_s
    while True:
        try:
            return act()
        except Exception as error:
            if not _lacks_descriptor(error) or time.monotonic() > give_up_s:
                raise
        time.sleep(_AGAIN_S)


def _lacks_descriptor(error: BaseException | None) -> bool:
    """Return whether ``error``, or its cause, is that no descriptor was free."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in NO_DESCRIPTOR:
            return True
        error = error.__cause__
    return False
