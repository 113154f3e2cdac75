"""A lateral sweep of independent code, for all tests of its analysis."""

from __future__ import annotations

import pytest
from support.lugre.bench import known_rig
from support.lugre.lateral_bench import LateralBench

from rigd_analyses.lugre.lateral.constants import LateralTrial
from rigd_analyses.lugre.trials.known_constants import RigConstants

SPEEDS_M_S, CURRENTS_A = (0.2, 0.65), (0.6, 1.2)


@pytest.fixture(scope="package")
def lateral_bench() -> LateralBench:
    """Return the maker of trials."""
    return LateralBench()


@pytest.fixture(scope="package")
def rig(lateral_bench: LateralBench) -> RigConstants:
    """Return the rig-file constants of the independent simulator."""
    return known_rig(lateral_bench.bench.constants)


@pytest.fixture(scope="package")
def trials(lateral_bench: LateralBench) -> list[LateralTrial]:
    """Return eight trials: two speeds, two currents, both directions."""
    return lateral_bench.sweep(2, SPEEDS_M_S, CURRENTS_A)


@pytest.fixture(scope="package")
def fast(lateral_bench: LateralBench) -> list[LateralTrial]:
    """Return the four trials of the fastest lateral motion, the shortest of all."""
    return lateral_bench.sweep(2, SPEEDS_M_S[1:], CURRENTS_A)
