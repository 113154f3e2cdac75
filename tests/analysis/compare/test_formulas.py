"""Data that rest on derived channels: of one formula, or not fitted together, not compared."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support.recordings.altered import Content

from rigd.analysis import Options
from rigd.analysis.api import identify
from rigd.analysis.check import Case, SimulatedTrial, write_case
from rigd.analysis.compare.campaign import read_campaigns
from rigd.analysis.compare.comparison import compare
from rigd.analysis.recordings.corrections import Corrections
from rigd.model.errors import DataError
from rigd.record import Attachment
from rigd_analyses.static.analysis import StaticFrictionAnalysis

RIG = """\
rig: case
title: A bench
cycle: 1 kHz
devices: {axis: {driver: not-installed-here}}
interlocks: []
derived:
  half.load: {is: FORMULA}
  bench.force: {is: axis.pull - half.load}
"""


def recorded(path: Path, formula: str, seed: int) -> Path:
    """Write strokes of six speeds; their force is derived, by ``formula`` of half.load."""
    random, t_s = np.random.default_rng(seed), np.arange(0.0, 2.0, 0.01)
    strokes = []
    for top in (0.0005, 0.001, 0.002, 0.004, 0.01, 0.1):
        speed = np.interp(t_s, [0.0, 0.2, 1.8, 2.0], [0.0, top, top, 0.0])
        force = 60.0 + 15.0 * np.exp(-((speed / 0.002) ** 2)) + 300.0 * speed
        force = force * np.sign(speed) + random.normal(0.0, 0.5, len(speed))
        strokes.append(SimulatedTrial(t_s, {"force": force, "speed": speed}))
    case, plain = Case(strokes, {}, {}), path.with_name(f"plain-{path.name}")
    write_case(plain, StaticFrictionAnalysis, case, model="static-friction")
    rig = RIG.replace("FORMULA", formula).encode()
    return Content.of(plain).write(path, Attachment("rig.yaml", "application/yaml", rig))


def compared(first: Path, second: Path) -> int:
    groups = {path.stem: [path] for path in (first, second)}
    found = read_campaigns(groups, Options(), Corrections(), lambda _: None, lambda _: None)
    return len(compare(found).compared)


def test_signals_of_another_formula_are_refused(tmp_path: Path) -> None:
    first = recorded(tmp_path / "a.mcap", "axis.load / 2", 1)
    second = recorded(tmp_path / "b.mcap", "axis.load / 3", 2)
    with pytest.raises(DataError) as refused:
        compared(first, second)
    assert refused.value.message == (
        f"a and b are identified from half.load, which is 'axis.load / 2' in {first} and "
        f"'axis.load / 3' in {second}"
    )


def test_saved_result_of_another_formula_is_refused(tmp_path: Path) -> None:
    first = recorded(tmp_path / "a.mcap", "axis.load / 2", 1)
    second = recorded(tmp_path / "b.mcap", "axis.load / 3", 2)
    saved = tmp_path / "saved.json"
    saved.write_text(json.dumps(identify(first).to_json(), allow_nan=False))
    with pytest.raises(DataError, match=r"are identified from half\.load"):
        compared(saved, second)


def test_signals_of_one_formula_are_compared(tmp_path: Path) -> None:
    first = recorded(tmp_path / "a.mcap", "axis.load / 2", 1)
    assert compared(first, recorded(tmp_path / "b.mcap", "axis.load/2", 2)) > 0


def test_signals_of_two_formulas_are_not_fitted_together(tmp_path: Path) -> None:
    first = recorded(tmp_path / "a.mcap", "axis.load / 2", 1)
    second = recorded(tmp_path / "b.mcap", "axis.load / 3", 2)
    with pytest.raises(DataError) as refused:
        identify([first, second])
    assert refused.value.message == (
        f"signals rest on half.load, which is 'axis.load / 2' in {first} and 'axis.load / 3' in "
        f"{second}"
    )
    apart = identify([first, second], by_recording=True)
    assert len(apart.groups) == 2


def test_signals_of_one_formula_are_fitted_together(tmp_path: Path) -> None:
    first = recorded(tmp_path / "a.mcap", "axis.load / 2", 1)
    again = recorded(tmp_path / "b.mcap", "axis.load/2", 2)
    found = identify([first, again])
    assert (len(found.groups), len(found.origins)) == (1, 2)
