"""A process with more open descriptors than `select.select` can name."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager

#: `select.select` takes descriptors below 1024 (FD_SETSIZE) alone.
HELD = 1100


@contextmanager
def beyond_select() -> Iterator[None]:
    """Hold so many descriptors that each new one is above 1024; raise their limit if needed."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 4 * HELD), hard))
    held = [os.open(os.devnull, os.O_RDONLY) for _ in range(HELD)]
    try:
        yield
    finally:
        for descriptor in held:
            os.close(descriptor)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
