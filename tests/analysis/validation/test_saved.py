"""A model file is read back, or refused with its place and what to do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from rigd.analysis.validation.saved_models import SavedModel, chosen, differing, read_models
from rigd.model.errors import ConfigError


def written(folder: Path, data: object) -> Path:
    path = folder / "model.json"
    path.write_text(json.dumps(data, indent=1), "utf-8")
    return path


def group(name: str, **conditions: str) -> dict[str, Any]:
    return {"model": "lugre", "group": name, "conditions": conditions, "x": {"y": [1.5, 2.5]}}


def models(folder: Path, *groups: dict[str, Any]) -> tuple[SavedModel, ...]:
    return read_models(written(folder, {"groups": list(groups)}))


def test_one_group_and_several_are_read(tmp_path: Path) -> None:
    (read,) = read_models(written(tmp_path, group("stone", floor="stone")))
    assert (read.model, read.group, read.conditions) == ("lugre", "stone", {"floor": "stone"})
    assert read.number("x", "y", 1) == 2.5
    assert read.numbers("x", "y", shape=(2,)).tolist() == [1.5, 2.5]
    several = models(tmp_path, group("stone"), group("pvc"))
    assert [item.group for item in several] == ["stone", "pvc"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", r"model\.json:1:2: this is no JSON"),
        ('{"model": "lugre",\n "x": }', r"model\.json:2:7: this is no JSON"),
        ('{"x": NaN}', "NaN is no JSON number"),
        ("[]", "must be one JSON object"),
        ("{}", "names no model"),
        ('{"groups": []}', "groups must be a list"),
        ('{"groups": [3]}', r"model\.json:1:13: a model must be a JSON object"),
        ('{"model": "lugre", "conditions": 3}', "conditions must be names with values"),
    ],
)
def test_file_of_another_form_is_refused(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    path.write_text(text, "utf-8")
    with pytest.raises(ConfigError, match=words):
        read_models(path)


def test_recording_in_place_of_model_is_named(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(ConfigError, match="it is a recording"):
        read_models(path)
    with pytest.raises(ConfigError, match="No such file"):
        read_models(tmp_path / "none.json")


@pytest.mark.parametrize(
    ("keys", "shape", "words"),
    [
        (("x", "z"), (2,), r"x\.z must be 2 numbers"),
        (("x", "y"), (3, 3), r"x\.y must be 3 x 3 numbers"),
        (("group",), (1,), r"group must be 1 numbers"),
    ],
)
def test_array_of_another_shape_is_refused(
    keys: tuple[str, ...], shape: tuple[int, ...], words: str, tmp_path: Path
) -> None:
    (read,) = read_models(written(tmp_path, group("stone")))
    with pytest.raises(ConfigError, match=words):
        read.numbers(*keys, shape=shape)


def test_missing_or_wrong_number_gives_its_line(tmp_path: Path) -> None:
    first, second = models(tmp_path, group("stone"), {**group("pvc"), "x": {"y": "high"}})
    with pytest.raises(ConfigError, match=r"x\.z is missing"):
        first.number("x", "z")
    with pytest.raises(ConfigError, match=r"x\.y is 'high', must be a number") as raised:
        second.number("x", "y")
    lines = second.path.read_text().splitlines()
    assert raised.value.place is not None
    assert '"high"' in lines[raised.value.place.line - 1]


def test_model_of_the_same_conditions_is_chosen(tmp_path: Path) -> None:
    found = models(tmp_path, group("stone", floor="stone"), group("pvc", floor="pvc"))
    assert chosen(found, {"floor": "pvc", "mass": "2 kg"}).group == "pvc"
    assert chosen(found, {"floor": "pvc"}, "stone").group == "stone"


@pytest.mark.parametrize(
    ("conditions", "named", "words"),
    [
        ({"floor": "paperboard"}, "", "no model for trials with floor paperboard"),
        ({}, "", "several models for trials with no conditions"),
        ({"floor": "pvc"}, "wood", "has no such model"),
    ],
)
def test_no_or_several_models_are_refused(
    conditions: dict[str, str], named: str, words: str, tmp_path: Path
) -> None:
    found = models(tmp_path, group("stone", floor="stone"), group("pvc", floor="pvc"))
    with pytest.raises(ConfigError, match=words) as raised:
        chosen(found, conditions, named)
    assert "it has stone, pvc" in str(raised.value)


def test_single_model_is_tried_on_other_conditions(tmp_path: Path) -> None:
    found = models(tmp_path, group("stone", floor="stone"))
    assert chosen(found, {"floor": "pvc"}) is found[0]
    assert differing(found[0], {"floor": "pvc", "mass": "2 kg"}) == ("floor",)
