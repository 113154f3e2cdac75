"""Recordings with spoilt content end with a result or a refusal; a warning would be an error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.approach_angle.recording import calibration_of, small_campaign, write_campaign
from support.cases import some
from support.recordings.altered import Content, ending, spoilt
from support.recordings.shipped_runs import Pair, play

from rigd.analysis.analysis import Options
from rigd.config.loader import load_rig
from rigd.sdk.shipped_files import shipped_folder


@pytest.fixture(scope="module")
def lugre(tmp_path_factory: pytest.TempPathFactory) -> Content:
    """Return four trials of the omni-wheel rig; the first does not move."""
    pair = Pair(shipped_folder("procedures") / "constant_current.yaml", load_rig("lugre-1"))
    path = tmp_path_factory.mktemp("lugre") / "lugre.mcap"
    play(pair, 1, path, trials=4)
    return Content.of(path)


@pytest.fixture(scope="module")
def angle(tmp_path_factory: pytest.TempPathFactory) -> Content:
    """Return a campaign of the approach-angle rig."""
    trials = small_campaign()
    path = tmp_path_factory.mktemp("angle") / "angle.mcap"
    return Content.of(write_campaign(path, trials, calibration=calibration_of(trials[0].run)))


@pytest.mark.parametrize("seed", some(range(100), 60, 10))
def test_spoilt_friction_trials_end_in_order(lugre: Content, tmp_path: Path, seed: int) -> None:
    content, ways = spoilt(lugre, np.random.default_rng(seed))
    assert ending(content.write(tmp_path / "spoilt.mcap"), Options(method="slip-force")), ways


@pytest.mark.parametrize("seed", some(range(100), 50, 25))
def test_spoilt_angle_campaigns_end_in_order(angle: Content, tmp_path: Path, seed: int) -> None:
    content, ways = spoilt(angle, np.random.default_rng(seed))
    assert ending(content.write(tmp_path / "spoilt.mcap"), Options()), ways
