"""Gains by a relay: the swing of a body with dead time, whose response is known exactly."""

from __future__ import annotations

import cmath
import math
import os
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from rigd.analysis import Options
from rigd.analysis.calibration.evaluation import CalibrationEvaluation
from rigd.analysis.check import Case, SimulatedTrial, write_case
from rigd.analysis.recordings.source import open_sweep
from rigd.analysis.result import FloatArray
from rigd_analyses.relay.analysis import RelayAnalysis

H = 1e-3  # s
GAIN = 25.0  # of the body, in 1/s
DEAD = 8  # cycles from the output to what it moves
Signals = dict[str, FloatArray]


def swing(
    *, relay: float = 0.5, hysteresis: float = 0.05, noise: float = 0.0, seed: int = 1,
    seconds: float = 1.5, needs: float = 0.3, gain: float = GAIN,
) -> Signals:  # fmt: skip
    """Return the signals of a body (dy/dt = gain (u - needs), after a dead time) and its relay."""
    rng = np.random.default_rng(seed)
    count = round(seconds / H)
    noises = noise * rng.standard_normal(count)
    true, side, late = 0.0, 1.0, [needs] * DEAD
    y, u = np.zeros(count), np.zeros(count)
    for k in range(count):
        y[k] = true + noises[k]
        if abs(y[k]) > hysteresis:
            side = -math.copysign(1.0, y[k])
        u[k] = needs + side * relay
        late.append(u[k])
        true += H * gain * (late.pop(0) - needs)
    return {"measured": y, "output": u, "relay": u - needs}


def response(period_s: float) -> complex:
    """Return the exact response of the sampled body at a period: K h z^-d / (z - 1)."""
    z = cmath.exp(2j * math.pi * H / period_s)
    return GAIN * H * z**-DEAD / (z - 1)


def evaluated(folder: Path, signals: Signals) -> CalibrationEvaluation:
    times = np.asarray(H * np.arange(len(signals["measured"])), dtype=np.float64)
    trial = SimulatedTrial(times, signals)
    path = write_case(folder / "relay.mcap", RelayAnalysis, Case([trial], constants={}, truth={}))
    found = RelayAnalysis().evaluate([open_sweep(path)], Options(), lambda line: None)
    assert isinstance(found, CalibrationEvaluation)
    return found


def test_gains_are_those_of_the_exact_response(tmp_path: Path) -> None:
    found = evaluated(tmp_path, swing()).result
    ultimate, period = (found.measured[name].value for name in ("ultimate_gain", "ultimate_period"))
    assert ultimate == pytest.approx(1 / abs(response(period)), rel=1e-9)
    assert period == pytest.approx(4 * (DEAD * H + 0.05 / (0.5 * GAIN)), rel=0.1)
    assert found.measured["kp"].value == pytest.approx(ultimate / 3.2)
    assert found.measured["ki"].value == pytest.approx(ultimate / 3.2 / (2.2 * period))


def test_calibration_of_others_has_date_of_file(tmp_path: Path) -> None:
    signals = swing()
    trial = SimulatedTrial(np.asarray(H * np.arange(len(signals["measured"]))), signals)
    path = write_case(tmp_path / "run.mcap", RelayAnalysis, Case([trial], constants={}, truth={}))
    os.utime(path, (1e9, 1e9))
    sweep = open_sweep(path)
    sweep = replace(sweep, info=replace(sweep.info, mode="", started="", metadata={}))
    found = RelayAnalysis().evaluate([sweep], Options(), lambda line: None)
    assert isinstance(found, CalibrationEvaluation)
    assert found.made == date(2001, 9, 9)


@pytest.mark.parametrize("seed", range(4))
def test_interval_holds_the_response_in_noise(tmp_path: Path, seed: int) -> None:
    found = evaluated(tmp_path, swing(noise=0.02, hysteresis=0.08, seed=seed)).result
    ultimate, period = (found.measured[name] for name in ("ultimate_gain", "ultimate_period"))
    truth = 1 / abs(response(period.value))
    assert abs(ultimate.value - truth) < 3 * ultimate.u
    assert 0 < ultimate.u < 0.05 * truth


def test_rig_that_answers_downwards_gets_negative_gains(tmp_path: Path) -> None:
    upwards = swing()
    found = evaluated(tmp_path, {**upwards, "measured": -upwards["measured"]}).result
    assert found.measured["kp"].value < 0
    assert found.measured["ki"].value < 0
    assert not found.refusals


def _pid(signals: Signals) -> Signals:
    return {**signals, "relay": 0.3 * signals["measured"] + 0.01}


def _slow(signals: Signals) -> Signals:
    """Return ``signals`` with a new reading in every eighth cycle."""
    y = signals["measured"]
    return {**signals, "measured": y[np.arange(len(y)) // 8 * 8]}


def _dead(signals: Signals) -> Signals:
    return {**signals, "measured": np.full_like(signals["measured"], 0.1)}


@pytest.mark.parametrize(
    ("signals", "why"),
    [
        (_pid(swing()), "more than two values"),
        ({**swing(), "relay": np.zeros(1500)}, "did not act"),
        (swing(seconds=0.3), "for longer"),
        (_dead(swing()), "stays the same"),
        (_slow(swing()), "more often"),
        (swing(noise=0.15, hysteresis=0.05, seconds=3), "larger hysteresis"),
        (swing(noise=0.05, hysteresis=0.06, seconds=3), "above the noise"),
        (swing(hysteresis=3.0, seconds=20), "smaller hysteresis"),
        (swing(hysteresis=3.0, seconds=20), "near 90 degrees the rig integrates"),
    ],
)
def test_swing_without_gains_is_refused(tmp_path: Path, signals: Signals, why: str) -> None:
    found = evaluated(tmp_path, signals)
    assert not found.result.measured
    assert any(why in reason for reason in found.result.refusals), found.result.refusals
    assert "no tuning" in str(found.terminal_report()[0])
    assert not found.opening.not_usable.endswith("?.")


def test_lopsided_swing_is_refused(tmp_path: Path) -> None:
    signals = swing()
    high = signals["relay"] > 0
    keep = np.flatnonzero(high | (np.arange(len(high)) % 4 == 0))
    short = {name: values[keep] for name, values in signals.items()}
    (why,) = evaluated(tmp_path, short).result.refusals
    assert "above its middle" in why


def test_pause_of_the_relay_parts_its_swings(tmp_path: Path) -> None:
    """The first swings after a pause count as little as those at the begin, and none is drawn."""
    first, second = swing(), swing(seconds=0.3)
    second["measured"][:80] *= 3.0
    rest = {"measured": np.zeros(500), "output": np.full(500, 0.3), "relay": np.zeros(500)}
    signals = {name: np.concatenate([first[name], rest[name], second[name]]) for name in rest}
    found = evaluated(tmp_path, signals)
    assert not found.result.refusals
    (tmp_path / "alone").mkdir()
    alone = evaluated(tmp_path / "alone", first).result.measured["ultimate_gain"].value
    assert found.result.measured["ultimate_gain"].value == pytest.approx(alone, rel=1e-6)
    assert all(len(item.x) == len(item.fitted) for item in found.result.series)
    assert "the last swings" in found.report()
