"""Lets a process end with the one that started it, however that one ends."""

from __future__ import annotations

import ctypes
import os
import signal
from typing import Final

_PR_SET_PDEATHSIG: Final = 1  # <linux/prctl.h>


def end_with(parent: int, by: signal.Signals) -> bool:
    """Let the kernel send the signal ``by`` to this process when the process ``parent`` ends.

    It does so too when the thread of ``parent`` ends that started this one (prctl(2),
    PR_SET_PDEATHSIG); exec keeps this setting. Linux only. Returns False if ``parent`` has ended
    already.

    Raises:
        OSError: the kernel refuses.
    """
    if ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, by, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return os.getppid() == parent
