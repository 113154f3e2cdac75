"""Rigs that answer."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from support.answering_rig import Served, served


@pytest.fixture
def remote() -> Iterator[Served]:
    """A rig that answers every verb."""
    with served() as found:
        yield found
