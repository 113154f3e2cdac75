"""Recordings whose samples were cut out: bridged, or the trial is left out; the truth is held."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.cases import some
from support.lugre.random_rigs import RandomRig, measured, random_rig
from support.recordings.altered import Content

from rigd.analysis import Options
from rigd.analysis.evaluation import evaluate
from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.result import IdentificationResult
from rigd.model.errors import DataError
from rigd.record.read.resample import LONGEST_BRIDGE

MS = 1_000_000
CURRENTS = "[0.3 A, 0.6 A, 0.9 A, 1.2 A]"
WORLDS = [("stone", 5), ("pvc", 6), ("paperboard", 7), ("pvc", 0)]
#: Worlds with how many rows are cut, at 1 kHz.
CASES = [(world, rows) for rows in (3, 30, 200) for world in WORLDS]
AFTER_STEP_NS, LAST_NS = 60 * MS, 20 * MS


def cut(content: Content, trial: int, rows: int, *, shifted: bool, seed: int) -> Content:
    """Return a copy without some rows in the drive of a trial (from 0), in all streams.

    ``shifted``: what follows in the trial stands earlier, so that its times show no gap.
    """
    copy = content.copy()
    signals = copy.plan("signals")
    starts = [event.t_ns for event in copy.events if event.kind == "trial_start"]
    begin, end = starts[trial], [*starts[1:], 2**62][trial]

    def times(signal: str) -> tuple[Any, Any]:
        stream, _, channel = signals[signal].partition(".")
        found = copy.rows[stream]
        at = found["t_ns"].astype(np.int64)
        inside = (at >= begin) & (at < end)
        return at[inside], found[channel][inside]

    at, current = times("motor_current")
    first = int(at[np.abs(current) > 0.05][0])
    at, held = times("carriage_held")
    last = int(at[(at > first + AFTER_STEP_NS) & (held > 0.5)][0])
    random = np.random.default_rng([seed, rows])
    lost = int(random.integers(first + AFTER_STEP_NS, last - rows * MS - LAST_NS))
    for stream in {signal.partition(".")[0] for signal in signals.values()}:
        found = copy.rows[stream]
        at = found["t_ns"].astype(np.int64)
        kept = (at < lost) | (at >= lost + rows * MS)
        if shifted:
            found["t_ns"][(at >= lost + rows * MS) & (at < end)] -= rows * MS
        copy.rows[stream] = found[kept]
    return copy


def outcome(path: Path) -> IdentificationResult | str:
    """Return the result, or the sentence with which the recording is refused."""
    try:
        evaluation = evaluate([path], Options())
    except DataError as error:
        return error.message
    assert isinstance(evaluation, ParameterEvaluation)
    return evaluation.sections[0].result


def check(rig: RandomRig, result: IdentificationResult) -> None:
    """Check that each number holds the truth."""
    for name, truth in rig.truth.items():
        entry = result.parameter(name)
        if entry.quoted is not None:
            assert entry.low is None or entry.low <= truth, entry
            assert entry.high is None or truth <= entry.high, entry
    curve = result.curve
    true = rig.friction(curve.x)
    assert np.all((curve.low <= true) & (true <= curve.high))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., tuple[RandomRig, Content]]:
    """Return the maker of a rig and of what it recorded, its constants within their u."""

    @cache
    def record(floor: str, number: int) -> tuple[RandomRig, Content]:
        folder = tmp_path_factory.mktemp(floor)
        rig = random_rig(number, floor, folder, currents=CURRENTS)
        rig.record(folder / "run.mcap", seed=number)
        return rig, Content.of(measured(folder / "run.mcap", number, floor))

    return record


@pytest.mark.parametrize(("world", "rows"), some(CASES, 4, 1))
def test_missing_rows_are_bridged_or_left_out(
    recorded: Callable[..., tuple[RandomRig, Content]], world: Any, rows: int, tmp_path: Path
) -> None:
    rig, content = recorded(*world)
    path = cut(content, 1, rows, shifted=False, seed=world[1]).write(tmp_path / "gap.mcap")
    result = outcome(path)
    assert isinstance(result, IdentificationResult), result
    check(rig, result)
    rejected = [item.reason for item in result.preprocessing.rejected]
    assert any("samples" in reason for reason in rejected) == (rows > LONGEST_BRIDGE), rejected


@pytest.mark.parametrize(("world", "rows"), some(CASES, 4, 2))
def test_trial_with_hidden_cut_is_left_out(
    recorded: Callable[..., tuple[RandomRig, Content]], world: Any, rows: int, tmp_path: Path
) -> None:
    rig, content = recorded(*world)
    path = cut(content, 1, rows, shifted=True, seed=world[1]).write(tmp_path / "hidden.mcap")
    result = outcome(path)
    if isinstance(result, str):  # too few others move
        assert "both encoders jump by the way of" in result
        return
    check(rig, result)
    (cause,) = [item.reason for item in result.preprocessing.rejected if "jump" in item.reason]
    way = re.search(r"by the way of ([+-][\d.]+) rows", cause)
    assert way is not None, cause
    assert float(way[1]) == pytest.approx(rows, rel=0.01, abs=0.5)
