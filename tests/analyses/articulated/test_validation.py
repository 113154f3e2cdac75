"""A model of the contacts is confirmed or rejected by recordings of a second author's robot."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))
from blind.robot import Robot, Trial, draw, write

from rigd.analysis.recordings.corrections import Corrections
from rigd.analysis.validation.evaluation import validate
from rigd.analysis.validation.result import GroupValidation, ModelOutcome
from rigd.model.errors import ConfigError

#: Relative half widths of a good identification.
WIDTHS = {"k_lon": 0.01, "k_lat": 0.01, "k_roll": 0.015, "mu_d": 0.01, "mu_s": 0.04}
UNITS = {"k_lon": "N s/m", "k_lat": "N s/m", "k_roll": "m", "mu_d": "1", "mu_s": "1"}
GRIPPING = [
    *(Trial(speed, speed, 0.5, 2.0) for speed in (100.0, 200.0, 300.0)),
    Trial(180.0, 90.0, 0.3, 6.0), Trial(90.0, 180.0, 0.3, 6.0),
]  # fmt: skip
SLIDING = [Trial(400.0, 400.0, 1e-3, 2.0), Trial(440.0, 220.0, 0.3, 6.0)]
Validated = Callable[..., GroupValidation]


def robot(trials: list[Trial], seed: int) -> Robot:
    """Return robot 0 with other trials and noise of its own."""
    found = draw(0)
    found.trials, found.seed, found.motors.rate = trials, 100 + seed, 500.0
    return found


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    folder = tmp_path_factory.mktemp("robot")

    def path(name: str) -> Path:
        found = folder / f"{name}.mcap"
        if not found.exists():
            trials = GRIPPING if name == "gripping" else [*GRIPPING, *SLIDING]
            write(robot(trials, len(name)), found)
        return found

    return path


@pytest.fixture
def validated(recorded: Callable[[str], Path], tmp_path: Path) -> Validated:
    return partial(_validated, recorded, tmp_path)


def model(
    changes: Mapping[str, float] = MappingProxyType({}), without: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Return the true contacts as `rigd identify` gives them, each times its change."""
    parameters = {}
    for name, (value, _) in draw(0).truth().items():
        value *= changes.get(name, 1.0)
        ends = {"low": value * (1 - WIDTHS[name]), "high": value * (1 + WIDTHS[name])}
        parameters[name] = {"estimate": value, "unit": UNITS[name], **ends}
    for name in without:
        parameters[name] = {"estimate": None, "low": None, "high": None, "unit": "1"}
    return {"model": "articulated", "parameters": parameters}


def _validated(
    recorded: Callable[[str], Path], folder: Path, file: str, typed: dict[str, Any], **stated: str
) -> GroupValidation:
    path = folder / "model.json"
    path.write_text(json.dumps(typed), "utf-8")
    found = validate(path, [recorded(file)], corrections=Corrections(stated))
    (group,) = found.result.groups
    return group


def test_true_contacts_are_confirmed(validated: Validated) -> None:
    group = validated("gripping", model())
    assert group.outcome is ModelOutcome.CONFIRMED, group.sentence
    assert len(group.trials) == len(GRIPPING)
    for trial in group.trials:
        for deviation in trial.deviations:
            assert deviation.passes
        assert 0.2e-3 < trial.deviation("place").rms < 10e-3  # the noise of the camera


def test_true_contacts_that_slide_are_confirmed(validated: Validated) -> None:
    group = validated("all", model())
    assert group.outcome is ModelOutcome.CONFIRMED, (group.sentence, group.findings)
    assert "mu_d" in group.findings[0]


@pytest.mark.parametrize("change", [0.9, 1.1])
@pytest.mark.parametrize("name", ["k_lon", "k_lat", "k_roll"])
def test_contact_ten_percent_off_is_named(validated: Validated, name: str, change: float) -> None:
    group = validated("gripping", model({name: change}))
    assert group.outcome is ModelOutcome.REJECTED
    told = " ".join([group.sentence, *group.findings])
    size = re.search(rf"{name} would have to be ([+-][\d.e+]+) % off", told)
    assert size is not None, told
    assert float(size[1]) / 100 == pytest.approx(1.0 / change - 1.0, abs=0.05)


@pytest.mark.parametrize("change", [0.9, 1.1])
def test_sliding_friction_ten_percent_off_is_rejected(validated: Validated, change: float) -> None:
    group = validated("all", model({"mu_d": change, "mu_s": change}))
    assert group.outcome is ModelOutcome.REJECTED


def test_wrong_kinematic_radius_is_a_track(validated: Validated) -> None:
    """R = b (w_r + w_l) / (w_r - w_l): 3 % of b, which is stated to 0.5 mm, are 9 u."""
    true = draw(0).stated["half_track"][0]
    group = validated("gripping", model(), half_track=f"{1030 * true:.4f} mm +- 0.5 mm")
    assert group.outcome is ModelOutcome.REJECTED
    assert "half_track would have to be" in group.sentence
    (bias,) = [item for item in group.biases if item.name == "half_track"]
    assert bias.value == pytest.approx(true, rel=0.005)


def test_trials_that_slide_are_left_out(validated: Validated) -> None:
    group = validated("all", model(without=("mu_s", "mu_d")))
    assert group.outcome is ModelOutcome.CONFIRMED, group.sentence
    assert len(group.left_out) == len(SLIDING)
    assert "mu_s" in group.left_out[0].reason


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"unit": "N s/mm"}, "parameters.k_lon is in N s/mm, must be in N s/m"),
        ({"estimate": -3.0}, "k_lon is -3, must be above 0"),
        ({"low": 1e6}, "the interval of k_lon does not hold it"),
        ({"estimate": None}, "the model has no value of k_lon"),
    ],
)
def test_impossible_model_is_refused(
    validated: Validated, change: dict[str, Any], words: str
) -> None:
    typed = model()
    typed["parameters"]["k_lon"] |= change
    with pytest.raises(ConfigError, match=words):
        validated("gripping", typed)


def test_model_that_did_not_fit_is_refused(validated: Validated) -> None:
    with pytest.raises(ConfigError, match="did not fit the recordings"):
        validated("gripping", model() | {"gate": {"outcome": "does not fit"}})
