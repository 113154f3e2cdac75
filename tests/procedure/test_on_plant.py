"""The shipped procedures on the simulated plant: they play to the end, and inside every limit."""

from __future__ import annotations

import pytest

from rigd.config.rig import RigConfig
from rigd.dry_run import dry_run
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("quick", {}),
        ("constant_current", {"floor": "pvc"}),  # 0.15 A does not move here, and is no failure
        ("recommended_identification", {"floor": "paperboard"}),
        ("lateral_sweep", {"lateral_speed": "0.65 m/s"}),
        ("validation_masses", {"mass": "1.9593 kg", "floor": "paperboard"}),
    ],
)
def test_plays_to_the_end(rig: RigConfig, name: str, overrides: dict[str, str]) -> None:
    compiled = compile_procedure(load_procedure(name), rig, overrides)
    found = dry_run(compiled, rig, seed=1)
    assert found.refusals == ()
    assert found.result is not None
    assert found.result.exit_code == 0
    assert found.result.trials_done == len(compiled.trials)
    outside = [
        (peak.channel, peak.lowest, peak.highest, peak.limit_by)
        for peak in found.peaks
        if not peak.inside
    ]
    assert outside == []
