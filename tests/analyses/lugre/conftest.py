"""The maker of trials of the omni-wheel rig, for all tests of its analysis."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from support.lugre.bench import Bench


@pytest.fixture(scope="session")
def bench() -> Callable[..., Bench]:
    """Return the maker of benches: ``bench("stone")``, ``bench("pvc", noisy=False)``."""
    return Bench
