"""Friction of one campaign is tried on runs of another: right, wrong, and of another set."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from support.approach_angle.headless import simulate
from support.approach_angle.recording import Recorded, write_campaign

from rigd.analysis.evaluation import evaluate
from rigd.analysis.validation.evaluation import ValidationEvaluation, validate
from rigd.analysis.validation.result import ModelOutcome
from rigd.model.errors import ConfigError

Model = Callable[[float], Path]


@pytest.fixture(scope="module")
def identified(
    campaign: Sequence[Recorded], calibration: str, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, Any]]:
    """Return a recording of 24 runs, and what `rigd identify --json` prints of it."""
    path = tmp_path_factory.mktemp("identified") / "campaign.mcap"
    write_campaign(path, campaign, calibration=calibration)
    data: dict[str, Any] = json.loads(json.dumps(evaluate([path]).to_json()))
    return path, data


@pytest.fixture(scope="module")
def others(calibration: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording of six other runs of the same rig under other loads."""
    cells = [(load, voltage) for load in (5.0, 6.0) for voltage in (7.0, 8.5, 10.0)]
    runs = [
        Recorded(simulate("clean_15", *cell, seed=seed)) for seed, cell in enumerate(cells, 101)
    ]
    path = tmp_path_factory.mktemp("others") / "others.mcap"
    write_campaign(path, runs, calibration=calibration)
    return path


@pytest.fixture
def model(identified: tuple[Path, dict[str, Any]], tmp_path: Path) -> Model:
    """Write the model with its friction times a factor."""

    def write(factor: float = 1.0) -> Path:
        data = json.loads(json.dumps(identified[1]))
        for item in data["sets"].values():
            item["curve"]["mu"] = [factor * value for value in item["curve"]["mu"]]
        path = tmp_path / "model.json"
        path.write_text(json.dumps(data))
        return path

    return write


def test_other_runs_of_the_rig_confirm_it(model: Model, others: Path) -> None:
    found = validate(model(1.0), [others])
    assert isinstance(found, ValidationEvaluation)
    (group,) = found.result.groups
    assert (group.label, group.outcome) == ("clean_15", ModelOutcome.CONFIRMED)
    assert found.fits and found.telling
    assert len(group.trials) == 6
    for trial in group.trials:
        speed = trial.deviation("speed")
        assert trial.passes and speed.limit is not None and speed.limit < 0.2 * speed.size
    assert "clean_15" in found.report()


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_friction_a_tenth_off_is_rejected(model: Model, others: Path, factor: float) -> None:
    found = validate(model(factor), [others])
    assert not found.fits
    sign = "+" if factor < 1.0 else "-"
    assert f"F_r/N is {sign}" in found.result.groups[0].sentence


def test_friction_of_another_angle_is_rejected(model: Model, others: Path) -> None:
    assert not validate(model(1.0), [others], group="clean_45").fits


def test_own_recording_is_no_prediction(
    model: Model, identified: tuple[Path, dict[str, Any]]
) -> None:
    found = validate(model(1.0), [identified[0]])
    assert [group.label for group in found.result.groups] == [
        "clean_0", "clean_15", "clean_45", "coated_0",
    ]  # fmt: skip
    assert all("predicts nothing new" in " ".join(g.findings) for g in found.result.groups)


def test_set_that_model_lacks_is_refused(model: Model, others: Path) -> None:
    with pytest.raises(ConfigError, match="no such set"):
        validate(model(1.0), [others], group="clean_60")
