"""The shipped schema of procedures is the one the code gives, and fits the shipped files."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest
from ruamel.yaml import YAML

from rigd.procedure.source import procedure_schema
from rigd.sdk.shipped_files import shipped_folder

FILES = sorted(shipped_folder("procedures").glob("*.yaml"))


def test_schema_file_matches_the_code() -> None:
    file = shipped_folder("schemas") / "procedure.schema.json"
    assert json.loads(file.read_text()) == procedure_schema(), "run: rigd schema procedure"


def test_every_key_is_described() -> None:
    schema = procedure_schema()
    bare = [
        f"{part['title']}.{key}"
        for part in (schema, *schema["$defs"].values())
        for key, value in part.get("properties", {}).items()
        if not value.get("description")
    ]
    assert bare == []


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_shipped_file_is_valid_and_names_its_schema(file: Path) -> None:
    text = file.read_text()
    assert text.startswith("# yaml-language-server: $schema=../schemas/procedure.schema.json\n")
    validator = jsonschema.Draft202012Validator(procedure_schema())
    data = YAML(typ="safe", pure=True).load(text)
    validator.validate(data)
    data["trial"]["steps"][-1]["timeuot"] = "1 s"
    with pytest.raises(jsonschema.ValidationError):
        validator.validate(data)
