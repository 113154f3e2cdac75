"""A law that is pointwise in time needs no even times, and loggers of any rates fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.logged import FloatArray, LoggedTable, logged

from rigd.analysis import DataError, Options
from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.recordings.source import RecordedSweep
from rigd.analysis.result import IdentificationResult
from rigd_analyses.static.analysis import StaticFrictionAnalysis
from rigd_analyses.static.evaluation import steady

TRUTH = {"F_c": 5.0, "F_s": 6.0, "v_s": 0.005, "k_v": 4.0}
SPEEDS_M_S = (0.0015, 0.003, 0.005, 0.008, 0.02, 0.05, 0.1)
STROKE_S = 8.0
NOISE_N = 0.1


def speed_at(t_s: FloatArray) -> FloatArray:
    """Constant speeds one after the other, with ramps of 20 ms between them."""
    edges = STROKE_S * np.arange(1, len(SPEEDS_M_S))
    at = np.concatenate([[0.0], *([edge - 0.01, edge + 0.01] for edge in edges), [1e3]])
    speed: FloatArray = np.interp(t_s, at, np.repeat(SPEEDS_M_S, 2))
    return speed


def force_at(t_s: FloatArray, seed: int) -> FloatArray:
    v = speed_at(t_s)
    noise = np.random.default_rng(seed).normal(0.0, NOISE_N, len(v))
    drop = (TRUTH["F_s"] - TRUTH["F_c"]) * np.exp(-((v / TRUTH["v_s"]) ** 2))
    force: FloatArray = TRUTH["F_c"] + drop + TRUTH["k_v"] * v + noise
    return force


def times(rate_hz: float, jitter: float = 0.0, seed: int = 1) -> FloatArray:
    """Times in s, rounded to ms if they jitter, as a script logs them."""
    even = np.arange(0.0, STROKE_S * len(SPEEDS_M_S), 1.0 / rate_hz)
    if not jitter:
        return even
    moved = even + np.random.default_rng(seed).uniform(-jitter, jitter, len(even)) / rate_hz
    return np.unique(np.round(moved - moved[0], 3))


def found(sweep: RecordedSweep) -> IdentificationResult:
    evaluation = StaticFrictionAnalysis().evaluate([sweep], Options(starts=4), lambda _: None)
    assert isinstance(evaluation, ParameterEvaluation)
    (section,) = evaluation.sections
    return section.result


def near_truth(result: IdentificationResult) -> bool:
    """Return whether all are quoted, within 2 half widths: one in 10 000 lies beyond."""
    near = []
    for name, value in TRUTH.items():
        item = result.parameter(name)
        assert item.low is not None and item.high is not None, (name, result.warnings)
        near.append(abs(value - 0.5 * (item.low + item.high)) < item.high - item.low)
    return all(near)


def one_table(path: Path, t_s: FloatArray) -> RecordedSweep:
    columns = {"speed": ("m/s", speed_at(t_s)), "force": ("N", force_at(t_s, 3))}
    return logged(path, {"log": LoggedTable(t_s, columns)}, "static-friction")


@pytest.mark.parametrize("jitter", [0.1, 0.5])
def test_one_table_with_uneven_times_is_identified(jitter: float, tmp_path: Path) -> None:
    """It was refused: "stream 'log' does not fit the others", where there is no other."""
    result = found(one_table(tmp_path / "a.mcap", times(50.0, jitter)))
    assert near_truth(result)
    assert not any("straight line" in text for text in result.preprocessing.statements)


def test_gap_in_one_table_is_no_fault(tmp_path: Path) -> None:
    """Nothing has to be invented: 5 % of its rows are not there."""
    t_s = times(50.0)
    kept = t_s[(t_s % STROKE_S < 1.0) | (t_s % STROKE_S > 1.4)]
    assert near_truth(found(one_table(tmp_path / "a.mcap", kept)))


@pytest.mark.parametrize(
    ("force_hz", "speed_hz", "jitter"),
    [(200.0, 150.0, 0.0), (150.0, 200.0, 0.0), (200.0, 199.7, 0.0), (100.0, 80.0, 0.5),
     (400.0, 50.0, 0.3)],
)  # fmt: skip
def test_two_loggers_of_any_rates_are_identified(
    force_hz: float, speed_hz: float, jitter: float, tmp_path: Path
) -> None:
    """At like rates it was refused: "need at least 2 in every 6.667 ms"."""
    by_force, by_speed = times(force_hz, jitter, 1) + 0.0011, times(speed_hz, jitter, 2)
    tables = {
        "cell": LoggedTable(by_force, {"force": ("N", force_at(by_force, 3))}),
        "drive": LoggedTable(by_speed, {"speed": ("m/s", speed_at(by_speed))}),
    }
    result = found(logged(tmp_path / "a.mcap", tables, "static-friction"))
    assert near_truth(result)
    rule = "straight line in time" if force_hz < 2.0 * speed_hz else "mean of the samples"
    (stated,) = [text for text in result.preprocessing.statements if rule in text]
    assert "cell at" in stated and "drive at" in stated


def test_error_of_straight_lines_is_in_the_intervals(tmp_path: Path) -> None:
    """Of a force that waves as fast as its logger hardly shows, lines miss the tops."""
    by_force, by_speed = times(40.0), times(30.0)
    wave = 0.5 * np.sin(2.0 * np.pi * 13.0 * by_force)
    tables = {
        "cell": LoggedTable(by_force, {"force": ("N", force_at(by_force, 3) + wave)}),
        "drive": LoggedTable(by_speed, {"speed": ("m/s", speed_at(by_speed))}),
    }
    assert near_truth(found(logged(tmp_path / "a.mcap", tables, "static-friction")))


def test_rows_in_gap_of_another_logger_are_skipped(tmp_path: Path) -> None:
    by_force, by_speed = times(100.0), times(75.0)
    by_force = by_force[(by_force < 12.0) | (by_force > 15.0)]
    tables = {
        "cell": LoggedTable(by_force, {"force": ("N", force_at(by_force, 3))}),
        "drive": LoggedTable(by_speed, {"speed": ("m/s", speed_at(by_speed))}),
    }
    result = found(logged(tmp_path / "a.mcap", tables, "static-friction"))
    assert near_truth(result)
    (stated,) = [text for text in result.preprocessing.statements if "left out" in text]
    assert int(stated.split()[0]) == pytest.approx(3.0 * 75.0, abs=5)


def test_loggers_that_never_meet_are_refused(tmp_path: Path) -> None:
    by_force, by_speed = times(100.0), times(75.0) + 100.0
    tables = {
        "cell": LoggedTable(by_force, {"force": ("N", force_at(by_force, 3))}),
        "drive": LoggedTable(by_speed, {"speed": ("m/s", speed_at(by_speed - 100.0))}),
    }
    sweep = logged(tmp_path / "a.mcap", tables, "static-friction")
    with pytest.raises(DataError, match="cell, drive have no sample at the same time"):
        found(sweep)


@pytest.mark.parametrize("jitter", [0.1, 0.5])
def test_ramps_at_uneven_times_do_not_count(jitter: float) -> None:
    t_s = np.arange(0.0, 3.0, 0.01)
    t_s = t_s + 0.01 * np.random.default_rng(4).uniform(-jitter, jitter, len(t_s))
    speed = np.interp(t_s, [0.0, 0.2, 2.8, 3.0], [0.0, 0.1, 0.1, 0.0])
    counted = t_s[steady(t_s, speed, 0.1)]
    assert (counted[0], counted[-1]) == pytest.approx((0.29, 2.71), abs=0.03)
    assert len(counted) > 230
