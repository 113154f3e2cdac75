"""Any text of a rig file: a rig, or a ConfigError. Never another error, never a guess."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.cases import some

from rigd.config.document import parse_document
from rigd.config.loader import parse_rig
from rigd.model import ConfigError
from rigd.sdk.shipped_files import shipped_folder

TEXT = (shipped_folder("configs") / "sim_lugre.yaml").read_text()
FILE = Path("rig.yaml")
FUZZ = settings(
    max_examples=80, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
#: Characters and pieces that mean something to YAML, units or the schema.
PIECES = st.sampled_from(
    [*"{}[]:,#&*!|>'\"%@`?-~\t\n .$\\\0é", "\n- ", ": ", "<<: ", "1 A", "nan", "1e999 m",
     "null", "---\n", "%YAML 1.1\n---\n", "\u2028", "\x85", "\ufeff", "- " * 50, "km^999", "inf"]
)  # fmt: skip


def check(text: str) -> None:
    try:
        parse_rig(text, FILE)
    except ConfigError as error:
        for item in (error, *error.others):
            assert item.place is not None
            assert item.message


@FUZZ
@given(st.integers(0, len(TEXT)), st.integers(0, 60), PIECES)
def test_spoilt_file_gives_value_or_located_error(at: int, length: int, piece: str) -> None:
    check(TEXT[:at] + piece + TEXT[at + length :])


@FUZZ
@given(st.text(max_size=200))
def test_any_text_gives_value_or_located_error(text: str) -> None:
    check(text)


TREES = st.recursive(
    st.sampled_from(["1", "1 A", "x", "", "'", "true", "[", "-1 m/s"]),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3).map(lambda items: f"[{', '.join(items)}]"),
        st.dictionaries(
            st.sampled_from(["rig", "devices", "driver", "limits", "low", "name", "source"]),
            inner,
            max_size=3,
        ).map(lambda pairs: "{" + ", ".join(f"{k}: {v}" for k, v in pairs.items()) + "}"),
    ),
    max_leaves=8,
)


@FUZZ
@given(st.dictionaries(st.sampled_from(["rig", "title", "cycle", "plant", "devices", "interlocks",
                                        "constants", "x"]), TREES))  # fmt: skip
def test_valid_keys_with_any_values_give_located_errors(pairs: dict[str, str]) -> None:
    check("\n".join(f"{key}: {value}" for key, value in pairs.items()))


#: Every key but those the author invents: names of devices and constants.
PLACES = parse_document(TEXT, FILE).keys
KEYS = [
    path
    for path in PLACES
    if path[0] not in ("devices", "constants") or len(path) > 2 or len(path) == 1
]


@pytest.mark.parametrize("path", some(KEYS, 3), ids=lambda path: ".".join(map(str, path)))
def test_no_misspelt_key_goes_unnoticed(path: tuple[str | int, ...]) -> None:
    place = PLACES[path]
    lines = TEXT.split("\n")
    line, start, key = lines[place.line - 1], place.column - 1, str(path[-1])
    assert line[start:].startswith(key)
    lines[place.line - 1] = f"{line[:start]}{key}zz{line[start + len(key) :]}"
    with pytest.raises(ConfigError, match=f"'{key}"):
        parse_rig("\n".join(lines), FILE)
