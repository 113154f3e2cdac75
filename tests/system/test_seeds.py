"""Shipped procedures come to their end with any seed; `benchmarks/seeds.py` plays many more.

Those that another test plays whole are left to it.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from support.cases import some
from support.recordings.shipped_runs import Pair, pairs, play, wrong

TESTS = Path(__file__).parents[1]
WHOLE = {
    "quick": "procedure/test_on_plant.py",
    "constant_current": "procedure/test_on_plant.py",
    "recommended_identification": "procedure/test_on_plant.py",
    "lateral_sweep": "procedure/test_on_plant.py",
    "validation_masses": "procedure/test_on_plant.py",
    "calibrate_friction": "system/test_calibrate.py",
    "calibrate_load_cell": "system/test_calibrate.py",
    "calibrate_rise": "system/test_calibrate.py",
    "calibrate_scale": "system/test_calibrate.py",
    "calibrate_torque": "system/test_calibrate.py",
    "circles": "system/test_articulated.py",
}


@pytest.fixture(scope="module")
def shipped() -> list[Pair]:
    """Return all pairs: not at import, as every worker of the suite would make them."""
    return list(pairs())


def test_each_rig_and_procedure_is_in_some_pair(shipped: list[Pair]) -> None:
    rigs = {
        *("lugre-1", "angle-1", "angle-cell-1", "articulated-1", "articulated-3"),
        "tribometer-1",
    }
    assert {pair.rig.name for pair in shipped} == rigs
    assert len({pair.procedure for pair in shipped}) == 17


@pytest.mark.parametrize(("procedure", "file"), WHOLE.items())
def test_procedure_tested_elsewhere_is_named_there(procedure: str, file: str) -> None:
    assert f'"{procedure}"' in (TESTS / file).read_text("utf-8")


def test_shipped_procedures_end_whole(shipped: list[Pair], tmp_path: Path) -> None:
    """Their first four trials, with a seed on which the campaign was once aborted."""
    ended = {
        pair.name: wrong(play(pair, 15_670_647, tmp_path / f"{pair.name}.mcap", trials=4))
        for pair in shipped
        if pair.procedure.stem not in WHOLE
    }
    assert ended == {
        "approach_angles on angle-1": "",
        "approach_angles on angle-cell-1": "",
        "breakaway on lugre-1": "",
        "chain_manoeuvres on articulated-3": "",
        "robot_manoeuvres on articulated-1": "",
        "sliding_speeds on tribometer-1": "",
        "straight_speeds on articulated-1": "",
    }


@pytest.mark.parametrize("seed", some((230, 835, 991, 1186, 2713, 4396, 6099), 2))
def test_blocks_as_late_as_they_come_trip_nothing(
    seed: int, shipped: list[Pair], tmp_path: Path
) -> None:
    """In the first seconds of these seeds a block's drawn latency is 35 ms to 45 ms."""
    campaign = next(pair for pair in shipped if pair.procedure.stem == "approach_angles")
    assert wrong(play(campaign, seed, tmp_path / "run.mcap", trials=2)) == ""
