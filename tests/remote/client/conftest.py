"""A rig that is served."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from support.daemon.served_rig import Served, serve


@pytest.fixture
def remote() -> Iterator[Served]:
    """A rig as it is served unless its file overrides it."""
    with serve() as found:
        yield found
