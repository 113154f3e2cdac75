"""Any text of a procedure file: a program, or a ConfigError with places."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rigd.config.document import parse_document
from rigd.config.loader import load_rig
from rigd.model import ConfigError
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import parse_procedure
from rigd.sdk.shipped_files import shipped_folder

RIG = load_rig("lugre-1")
FILE = Path("p.yaml")
TEXTS = {file.stem: file.read_text() for file in shipped_folder("procedures").glob("*.yaml")}
FUZZ = settings(
    max_examples=50, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
PIECES = st.sampled_from(
    [*"{}[]:,#&*!|>'\"%@`?-~\t\n .$\\\0é()+/", "${", "}", "${current}", " * 1e300", " / 0", "- ",
     " for ", " and ", " > ", "1 A", "nan", "1e999 m", "km^99", "-", "0", "null", "\n  x: 1\n"]
)  # fmt: skip


def check(text: str) -> None:
    try:
        compile_procedure(parse_procedure(text, FILE), RIG)
    except ConfigError as error:
        for item in (error, *error.others):
            assert item.place is not None
            assert item.message


@FUZZ
@given(st.data())
def test_spoilt_file_gives_value_or_located_error(data: st.DataObject) -> None:
    text = TEXTS[data.draw(st.sampled_from(sorted(TEXTS)))]
    at = data.draw(st.integers(0, len(text)))
    length = data.draw(st.integers(0, 40))
    check(text[:at] + data.draw(PIECES) + text[at + length :])


@FUZZ
@given(st.data())
def test_exchanged_values_give_result_or_located_error(data: st.DataObject) -> None:
    """Any value at the place of any other: right YAML, wrong meaning."""
    text = TEXTS[data.draw(st.sampled_from(sorted(TEXTS)))]
    lines = text.split("\n")
    pairs = [n for n, line in enumerate(lines) if ": " in line and not line.startswith("#")]
    found, other = data.draw(st.sampled_from(pairs)), data.draw(st.sampled_from(pairs))
    head, value = lines[found].split(": ", 1)[0], lines[other].split(": ", 1)[1]
    lines[found] = f"{head}: {value}"
    check("\n".join(lines))


@FUZZ
@given(st.text(max_size=200))
def test_any_text_gives_value_or_located_error(text: str) -> None:
    check(text)


def _named_by_the_author(path: tuple[str | int, ...]) -> bool:
    """Whether a key is a name the file itself, or the model it feeds, gives its meaning."""
    return (
        (len(path) == 2 and path[0] in ("parameters", "tables", "measure"))
        or (len(path) == 3 and path[:2] in (("identify", "constants"), ("identify", "signals")))
        or (len(path) == 5 and path[:3] == ("identify", "reference", "values"))
    )


def _meaning(path: tuple[str | int, ...]) -> tuple[str, ...]:
    """Return what the schema knows a key by, whatever item of a list it is in, and whatever name
    the author has given."""
    return tuple(
        "-" if isinstance(part, int) else "*" if _named_by_the_author(path[: n + 1]) else part
        for n, part in enumerate(path)
    )


def _cases() -> dict[str, list[tuple[str | int, ...]]]:
    """Return by file the keys to misspell: each that the schema knows, where it stands first."""
    found: dict[str, list[tuple[str | int, ...]]] = {}
    known: set[tuple[str, ...]] = set()
    for name, text in sorted(TEXTS.items()):
        keys = [path for path in parse_document(text, FILE).keys if not _named_by_the_author(path)]
        new = {_meaning(path): path for path in reversed(keys)}
        found[name] = [path for meaning, path in new.items() if meaning not in known]
        known |= new.keys()
    return {name: paths for name, paths in found.items() if paths}


CASES = _cases()


@pytest.mark.parametrize(("name", "paths"), CASES.items(), ids=CASES)
def test_no_misspelt_key_goes_unnoticed(name: str, paths: list[tuple[str | int, ...]]) -> None:
    text = TEXTS[name]
    places = parse_document(text, FILE).keys
    for path in paths:
        place = places[path]
        lines = text.split("\n")
        line, start, key = lines[place.line - 1], place.column - 1, str(path[-1])
        assert line[start:].startswith(key)
        lines[place.line - 1] = f"{line[:start]}{key}zz{line[start + len(key) :]}"
        with pytest.raises(ConfigError):
            compile_procedure(parse_procedure("\n".join(lines), FILE), RIG)
