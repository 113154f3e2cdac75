from __future__ import annotations

from collections.abc import Callable

import pytest

from rigd_sim.lugre.parameters import LugreParameters
from rigd_sim.lugre.plant import LugreConfig, LugrePlant

PERIOD_NS = 1_000_000


@pytest.fixture(scope="session")
def parameters() -> LugreParameters:
    shipped: LugreParameters = LugreConfig().read_parameters()
    return shipped


@pytest.fixture
def make_plant() -> Callable[..., LugrePlant]:
    def make(*, seed: int = 1, **options: object) -> LugrePlant:
        config = LugreConfig.model_validate(options)
        return LugrePlant(config, period_ns=PERIOD_NS, seed=seed)

    return make
