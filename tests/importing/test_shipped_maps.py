"""The shipped maps are right, and the shipped schema of maps is the one the code gives."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest
from ruamel.yaml import YAML

from rigd.importing import load_map
from rigd.importing.source import map_schema
from rigd.sdk.shipped_files import shipped_folder

MAPS = sorted(shipped_folder("maps").glob("*.yaml"))


def test_schema_file_matches_the_code() -> None:
    file = shipped_folder("schemas") / "map.schema.json"
    assert json.loads(file.read_text()) == map_schema(), (
        "run: rigd schema map > schemas/map.schema.json"
    )


@pytest.mark.parametrize("path", MAPS, ids=[path.stem for path in MAPS])
def test_shipped_map_is_right(path: Path) -> None:
    assert load_map(load_map(path).name).path.samefile(path)
    data = YAML(typ="safe", pure=True).load(path.read_text("utf-8"))
    jsonschema.Draft202012Validator(map_schema()).validate(data)
