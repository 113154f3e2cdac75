"""``python -m rigd.daemon.serve.tied PARENT COMMAND...``: a command that ends with its parent.

Where the parent is killed, nobody is left to end what it started; the kernel then sends SIGTERM
(prctl(2), PR_SET_PDEATHSIG; it stays in force over exec).
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from typing import Final

_PR_SET_PDEATHSIG: Final = 1  # <linux/prctl.h>


def main() -> None:
    """Become the command, unless the parent is gone already."""
    parent, *command = sys.argv[1:]
    if ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0) != 0:
        sys.exit(f"cannot be tied to process {parent}: {os.strerror(ctypes.get_errno())}")
    if os.getppid() == int(parent):
        os.execvp(command[0], command)


if __name__ == "__main__":
    main()
