"""The shipped schema and documentation describe every message as the code does."""

from __future__ import annotations

import json
import random
import re
from functools import cache
from pathlib import Path

import jsonschema
import pytest
from support.daemon.served_rig import request
from support.faults.spoilt import spoilt_payloads

from rigd.remote.protocol import VERBS, Kind, Refusal, decode, request_kind
from rigd.remote.protocol.schema import remote_schema
from rigd.sdk.shipped_files import shipped_folder

VERB_ROWS = [(kind, name) for kind, table in VERBS.items() for name in table]
DOCUMENT = Path(__file__).resolve().parents[3] / "docs" / "protocol.md"
_ROW = re.compile(r"^\| `(\w+)/(\w+)` \| (\w+) \| (yes|no) \| `(\w+)` \| `(\w+)` \|$", re.M)


def test_schema_file_matches_the_code() -> None:
    file = shipped_folder("schemas") / "remote.schema.json"
    assert json.loads(file.read_text()) == remote_schema(), "run: rigd schema remote"


@cache
def validator(kind: Kind, verb: str) -> jsonschema.Draft202012Validator:
    schema = remote_schema()
    wanted = schema["x-keys"][f"{kind.value}/<identity>/{verb}"]["request"]
    return jsonschema.Draft202012Validator({"$defs": schema["$defs"], **wanted})


@pytest.mark.parametrize(("kind", "verb"), VERB_ROWS)
def test_valid_request_fits_its_schema(kind: Kind, verb: str) -> None:
    validator(kind, verb).validate(json.loads(request(verb)))


@pytest.mark.parametrize(("kind", "verb"), VERB_ROWS)
def test_code_refuses_requests_that_schema_refuses(kind: Kind, verb: str) -> None:
    """The code refuses more: what is no JSON, a key twice, deep nesting."""
    checked, refused = validator(kind, verb), 0
    for payload in spoilt_payloads(random.Random(verb), request(verb), 40):
        try:
            message = json.loads(payload)
        except (ValueError, RecursionError):
            continue
        if list(checked.iter_errors(message)):
            refused += 1
            with pytest.raises(Refusal):
                decode(request_kind(VERBS[kind][verb].arguments), payload)
    assert refused > 5


def test_documented_request_is_valid() -> None:
    found = re.search(r'^{"v".*}$', DOCUMENT.read_text(), re.M)
    assert found is not None
    decode(request_kind(VERBS[Kind.ASK]["latest"].arguments), found[0].encode())


def test_the_documented_table_is_that_of_the_code() -> None:
    documented = {tuple(row) for row in _ROW.findall(DOCUMENT.read_text())}
    assert documented == {
        (
            kind.value,
            name,
            verb.rule.role.value,
            "yes" if verb.rule.needs_lease else "no",
            verb.arguments.__name__,
            verb.result.__name__,
        )
        for kind, table in VERBS.items()
        for name, verb in table.items()
    }
