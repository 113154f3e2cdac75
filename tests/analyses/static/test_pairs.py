"""The law is of any pair: torque over angular speed, or a coefficient; its units follow."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from support.logged import LoggedTable, logged

from rigd.analysis import DataError, Options
from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.recordings.source import RecordedSweep
from rigd_analyses.static.analysis import StaticFrictionAnalysis

#: Units of force and speed, that of k_v, and the axes.
PAIRS = [
    ("N", "m/s", "N s/m", ("speed", "friction")),
    ("N m", "rad/s", "N m s/rad", ("angular speed", "friction torque")),
    ("kg m^2/s^2", "rad/s", "N m s/rad", ("angular speed", "friction torque")),
    ("1", "m/s", "s/m", ("speed", "friction coefficient")),
    ("1", "rad/s", "s/rad", ("angular speed", "friction coefficient")),
]
SPEEDS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
TRUTH = {"F_c": 0.5, "F_s": 0.7, "v_s": 0.1, "k_v": 0.2}


def sweep_of(path: Path, force: str, speed: str) -> RecordedSweep:
    t_s = np.arange(0.0, 2.0 * len(SPEEDS), 0.01)
    v = np.repeat(SPEEDS, 200)
    drop = (TRUTH["F_s"] - TRUTH["F_c"]) * np.exp(-((v / TRUTH["v_s"]) ** 2))
    noise = np.random.default_rng(1).normal(0.0, 0.01, len(v))
    f = TRUTH["F_c"] + drop + TRUTH["k_v"] * v + noise
    columns = {"speed": (speed, v), "force": (force, f)}
    return logged(path, {"log": LoggedTable(t_s, columns)}, "static-friction")


def evaluated(*sweeps: RecordedSweep) -> ParameterEvaluation:
    found = StaticFrictionAnalysis().evaluate(sweeps, Options(starts=2), lambda _: None)
    assert isinstance(found, ParameterEvaluation)
    return found


@pytest.mark.parametrize(("force", "speed", "viscous", "axes"), PAIRS)
def test_units_of_results_follow_the_pair(
    force: str, speed: str, viscous: str, axes: tuple[str, str], tmp_path: Path
) -> None:
    found = evaluated(sweep_of(tmp_path / "a.mcap", force, speed))
    result = found.sections[0].result
    unit = "N m" if force.startswith("kg") else force
    wanted = {"F_c": unit, "F_s": unit, "v_s": speed, "k_v": viscous}
    assert {item.name: item.unit for item in result.parameters} == wanted
    for name, value in TRUTH.items():
        item = result.parameter(name)
        assert item.low is not None and item.high is not None
        assert abs(value - 0.5 * (item.low + item.high)) < item.high - item.low
    assert (result.curve.x_name, result.curve.y_name) == axes
    assert (result.curve.x_unit, result.curve.y_unit) == (speed, unit)
    others = {"m/s", "rad/s", "N s/m", "N m s/rad", "s/m", "s/rad"} - {speed, viscous}
    texts = [found.report(), str(found.to_json()), str(found.terminal_report())]
    for other in others:
        alone = re.compile(rf"(?<![\w ·/]){re.escape(other)}(?![\w/])")
        assert not any(alone.search(text) for text in texts), other


def test_group_of_two_pairs_is_refused(tmp_path: Path) -> None:
    sweeps = [
        sweep_of(tmp_path / "a.mcap", "N", "m/s"),
        sweep_of(tmp_path / "b.mcap", "N m", "rad/s"),
    ]
    with pytest.raises(DataError, match=r"of different quantities: .*N over m/s.*N m over rad/s"):
        evaluated(*sweeps)


def test_other_quantity_names_what_fits(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"log.force, in V; model .* works from N or N m or 1"):
        evaluated(sweep_of(tmp_path / "a.mcap", "V", "m/s"))
