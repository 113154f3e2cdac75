"""The file descriptors of the daemon: how many it has open, and how many it may.

So few connections may be unauthenticated at once (:mod:`rigd.remote.server.admission`), and so few
clients connected, that they leave most descriptors of the raised limit free.
"""

from __future__ import annotations

import resource
from pathlib import Path
from typing import Final

#: More than a rig with all its clients ever needs (about 100).
WANTED: Final = 65_536


def raise_limit() -> None:
    """Let this process open as many files and connections as are wanted, as far as it may."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = WANTED if hard == resource.RLIM_INFINITY else min(WANTED, hard)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


def counts() -> dict[str, int]:
    """Return how many are open and how many may be, for the status."""
    return {
        "descriptors": Path("/proc/self/fd").stat().st_size,  # 0 before Linux 6.2
        "descriptors_most": resource.getrlimit(resource.RLIMIT_NOFILE)[0],
    }
