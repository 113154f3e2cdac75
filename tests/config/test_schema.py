"""The shipped schema of rig files is the one the code gives, and fits the shipped files."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest
from ruamel.yaml import YAML

from rigd.config.schema import rig_schema
from rigd.sdk.shipped_files import shipped_folder


def test_schema_file_matches_the_code() -> None:
    file = shipped_folder("schemas") / "rig.schema.json"
    assert json.loads(file.read_text()) == rig_schema(), (
        "run: rigd schema rig > schemas/rig.schema.json"
    )


def test_every_key_is_described() -> None:
    schema = rig_schema()
    parts = [schema, *schema["$defs"].values()]
    bare = [
        f"{part['title']}.{key}"
        for part in parts
        for key, value in part.get("properties", {}).items()
        if not value.get("description")
    ]
    assert bare == []


@pytest.mark.parametrize(
    "file", sorted(shipped_folder("configs").glob("*.yaml")), ids=lambda file: file.stem
)
def test_every_shipped_rig_is_valid(file: Path) -> None:
    data = YAML(typ="safe", pure=True).load(file.read_text("utf-8"))
    jsonschema.Draft202012Validator(rig_schema()).validate(data)


def test_shipped_rig_is_valid_and_misspelt_is_not() -> None:
    validator = jsonschema.Draft202012Validator(rig_schema())
    file = shipped_folder("configs") / "sim_lugre.yaml"
    data = YAML(typ="safe", pure=True).load(file.read_text())
    validator.validate(data)
    data["cicle"] = data.pop("cycle")
    with pytest.raises(jsonschema.ValidationError):
        validator.validate(data)
