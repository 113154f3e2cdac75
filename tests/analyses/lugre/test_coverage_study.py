"""The study of coverage sees what varies nothing, and its rigs differ as real ones do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.lugre.coverage import RIGHT_RATIO, Found, coverage
from support.lugre.random_rigs import FLOORS, random_rig

from rigd.config.loader import load_rig
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.record import Recording
from rigd_sim.lugre.plant import LugreConfig, LugrePlant


def experiments(error_sd: float, half_width: float, count: int = 400) -> list[Found]:
    estimates = 1.0 + error_sd * np.random.default_rng(1).standard_normal(count)
    return [(e, e - half_width, e + half_width) for e in estimates.tolist()]


def test_right_intervals_cover_95_percent() -> None:
    found = coverage(experiments(0.02, 1.96 * 0.02))
    assert found.limits[0] < 95.0 < found.limits[1]
    assert found.ratio == pytest.approx(RIGHT_RATIO, rel=0.1)
    assert found.varies


def test_study_without_variation_is_detected() -> None:
    """Its intervals cover always, and errors spread over 0.5 % of them."""
    found = coverage(experiments(1e-4, 0.02))
    assert found.share == 100.0
    assert not found.varies


def test_few_experiments_leave_coverage_open() -> None:
    found = coverage([*experiments(0.0, 0.02, 3), (1.5, None, None)])
    assert (found.experiments, found.quoted, found.covered) == (4, 3, 3)
    assert found.limits == pytest.approx((29.2, 100.0), abs=0.1)


@pytest.mark.parametrize("floor", FLOORS)
def test_rigs_differ_in_friction_constants_and_starts(floor: str, tmp_path: Path) -> None:
    rigs = [random_rig(number, floor, _folder(tmp_path, number)) for number in (0, 1, 2)]
    for name in rigs[0].truth:
        assert len({rig.truth[name] for rig in rigs}) == 3, name
    for rig in rigs:
        config = load_rig(rig.rig)
        plan = compile_procedure(load_procedure(rig.procedure), config, {}).identify
        assert config.plant is not None
        assert plan is not None
        assert isinstance(config.plant.config, LugreConfig)
        plant = LugrePlant(config.plant.config, period_ns=1_000_000, seed=1)
        assert plan.constants["mass"] == pytest.approx(plant.mass, rel=1e-12)
        parameters = plant.parameters
        assert plan.constants["wheel_radius"] == pytest.approx(parameters.wheel.radius, rel=1e-12)
        known = getattr(parameters.floors, floor)
        # Of a load that the guide changes by its friction at most.
        lifted = known.sigma_0 / rig.truth["sigma_0"]
        most = float(plan.constants["guide_friction"]) / (plant.mass * 9.81)
        assert 0.0 <= abs(lifted - 1.0) <= 1.001 * most
        assert (lifted == 1.0) == (rig.number == 0)
        assert known.mu_static / rig.truth["mu_s"] == pytest.approx(lifted, rel=1e-12)
    assert rigs[0].truth["mu_c"] == pytest.approx({"paperboard": 0.04}.get(floor, 0.12))


def test_a_random_rig_plays_to_its_end(tmp_path: Path) -> None:
    rig = random_rig(4, "pvc", tmp_path)
    ended = rig.record(tmp_path / "run.mcap", seed=4)
    assert (ended.ending, ended.trials_done) == ("complete", 10)
    first = Recording.open(tmp_path / "run.mcap").read("wheel_encoder")["counts"][0]
    assert first != 0, "the wheel stands where its number says"


def _folder(parent: Path, number: int) -> Path:
    folder = parent / str(number)
    folder.mkdir()
    return folder
