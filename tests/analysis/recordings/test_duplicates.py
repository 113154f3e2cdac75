"""The noise of a trial is no new evidence at another time; trials without noise may be alike."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rigd.analysis import Options
from rigd.analysis.check import Case, SimulatedTrial, write_case
from rigd.analysis.compare.campaign import read_campaigns
from rigd.analysis.evaluation import open_sweeps
from rigd.analysis.recordings.corrections import Corrections
from rigd.model.errors import DataError
from rigd.record import Recording
from rigd_analyses.static.analysis import StaticFrictionAnalysis

TIMES_S = np.arange(0.0, 3.0, 0.01)
SPEED = np.full(len(TIMES_S), 0.01)


def trial(force: NDArray[np.float64], speed: NDArray[np.float64] = SPEED) -> SimulatedTrial:
    return SimulatedTrial(TIMES_S, {"force": force, "speed": speed})


def noisy(seed: int) -> SimulatedTrial:
    return trial(60.0 + np.random.default_rng(seed).normal(0.0, 0.5, len(TIMES_S)))


def opened(folder: Path, *recordings: list[SimulatedTrial]) -> None:
    paths = [
        write_case(folder / f"{number}.mcap", StaticFrictionAnalysis, Case(trials, {}, {}))
        for number, trials in enumerate(recordings, start=1)
    ]
    open_sweeps(paths, lambda _: None, None, lambda _: None)


def test_copy_at_another_time_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"trial 2 of .*2\.mcap has the samples of trial 1 of .*1"):
        opened(tmp_path, [noisy(1)], [noisy(2), noisy(1)])


def test_copy_within_one_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"trials 1 and 3 of .* have the same samples"):
        opened(tmp_path, [noisy(1), noisy(2), noisy(1)])


def test_trials_with_other_noise_pass(tmp_path: Path) -> None:
    opened(tmp_path, [noisy(1), noisy(2)], [noisy(3), noisy(4)])


def test_trial_without_overlap_is_read_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begins: list[int | None] = []
    read = Recording.read

    def counted(
        self: Recording, stream: str, start_ns: int | None = None, end_ns: int | None = None
    ) -> NDArray[np.void]:
        begins.append(start_ns)
        return read(self, stream, start_ns, end_ns)

    monkeypatch.setattr(Recording, "read", counted)
    opened(tmp_path, [noisy(1)], [noisy(2), noisy(3)])
    last = max(begin for begin in begins if begin is not None)
    assert begins.count(last) == 1


def test_copy_in_another_group_is_refused(tmp_path: Path) -> None:
    groups = {}
    for name, trials in (("before", [noisy(1)]), ("after", [noisy(2), noisy(1)])):
        path, case = tmp_path / f"{name}.mcap", Case(trials, {}, {})
        groups[name] = [write_case(path, StaticFrictionAnalysis, case, model="static-friction")]
    with pytest.raises(DataError) as refused:
        read_campaigns(groups, Options(), Corrections(), lambda _: None, lambda _: None)
    assert refused.value.message == (
        f"the groups hold a trial twice: trial 2 of {tmp_path / 'after.mcap'} has the samples of "
        f"trial 1 of {tmp_path / 'before.mcap'}, at other times"
    )


@pytest.mark.parametrize(
    "force",
    [
        np.zeros(len(TIMES_S)),
        np.round(20.0 * TIMES_S) / 20.0,
        np.where(np.arange(len(TIMES_S)) % 20 < 10, 1.0, -1.0),
        np.where(np.arange(len(TIMES_S)) % 30 == 0, 1.0, 0.0),
        60.0 * np.sin(40.0 * TIMES_S),
        60.0 + 1e-14 * np.random.default_rng(1).normal(size=len(TIMES_S)),
    ],
    ids=["zero", "coarse ramp", "square wave", "sensor at rest", "sine", "rounding"],
)
def test_trials_without_noise_may_be_alike(force: NDArray[np.float64], tmp_path: Path) -> None:
    opened(tmp_path, [trial(force)], [noisy(2), trial(force), trial(force)])
