"""Recordings of small campaigns, whole and spoilt."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from support.approach_angle.recording import (
    Recorded,
    calibration_of,
    small_campaign,
    write_campaign,
)

from rigd.analysis import Options
from rigd.analysis.evaluation import evaluate
from rigd_analyses.approach_angle.evaluation import CampaignEvaluation

Evaluate = Callable[..., CampaignEvaluation]
Record = Callable[..., Path]


@pytest.fixture(scope="session")
def campaign() -> tuple[Recorded, ...]:
    """24 good runs."""
    return small_campaign()


@pytest.fixture(scope="session")
def calibration(campaign: Sequence[Recorded]) -> str:
    """Return the calibration of the rig of :func:`campaign`."""
    return calibration_of(campaign[0].run)


@pytest.fixture
def record(tmp_path: Path, calibration: str) -> Record:
    """Write trials as a recording; one with the right calibration by default."""

    def write(trials: Sequence[Recorded], name: str = "campaign.mcap", **options: Any) -> Path:
        return write_campaign(tmp_path / name, trials, **{"calibration": calibration, **options})

    return write


@pytest.fixture
def analyse() -> Evaluate:
    """Evaluate recordings; with another calibration if one is given."""

    def run(*paths: Path, calibration: Path | None = None) -> CampaignEvaluation:
        found = evaluate(paths, Options(calibration=calibration))
        assert isinstance(found, CampaignEvaluation)
        return found

    return run
