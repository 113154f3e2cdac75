"""Old data of one stroke, two rates: one of four published parameters is determined, no more."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from rigd.analysis.analysis import Options
from rigd.analysis.check import intervals_of
from rigd.analysis.evaluation import evaluate_sweeps
from rigd.analysis.plan import find_analysis
from rigd.analysis.recordings.source import open_sweep
from rigd.importing import import_files, load_map

SCRIPT = Path(__file__).parents[2] / "examples/import/rack_and_pinion.py"


def test_one_stroke_determines_viscous_friction_alone(tmp_path: Path) -> None:
    subprocess.run([sys.executable, SCRIPT, tmp_path], check=True)
    files = sorted(tmp_path.glob("*.csv"))
    (made,) = import_files(load_map("rack_and_pinion"), files, tmp_path)
    sweep = open_sweep(made.path)
    assert sweep.plan.reference == pytest.approx(
        {"F_c": 5.0, "F_s": 8.0, "v_s": 0.004, "k_v": 400.0}
    )
    analysis = find_analysis(sweep.plan.model)
    found = intervals_of(evaluate_sweeps(analysis, [sweep], Options(starts=2), lambda _: None))
    assert [name for name, ends in found.items() if ends is not None] == ["k_v"]
    ends = found["k_v"]
    assert ends is not None
    assert ends[0] < 400.0 < ends[1]
    assert ends[1] - ends[0] < 40.0
