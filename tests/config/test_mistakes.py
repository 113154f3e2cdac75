"""Errors of a file are reported in words of the file, never in those of the parser."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

from rigd.config.document import parse_document
from rigd.model import ConfigError
from rigd.sdk.shipped_files import Kind, shipped_folder

FILE = Path("f.yaml")
#: Words of YAML parsers that mean nothing to the author of a file.
JARGON = re.compile(
    r"<\w[\w ]*>|\b(token|chomping|scalar|flow|block (end|mapping|collection|sequence)|node|stream|"
    r"simple key|while (parsing|scanning)|directives?|escape sequence|alphabetic|separator|"
    r"mapping values|sequence entries|document (start|end)|ruamel|yaml\.org)\b|http",
    re.IGNORECASE,
)
MISTAKES = {
    "a: 1\ntitle A title\ndoc: foo\n": (2, 1, "no ': ' after its key"),
    "a: 1\ntitle\n": (2, 1, "no ': ' after its key"),
    "procedure:x\ntitle: foo\n": (2, 6, "after the colon of the line above"),
    "a: 1\n  title: foo\n": (2, 8, "indented too far"),
    "t:\n  - a: 1\n    b: 2\n   c: x\n": (4, 4, "begins in line 2, column 3"),
    "t:\n    a: 1\n  b: 2\n": (3, 3, "begin in the same column"),
    "t:\n  until: |belt.speed| < 3 mm/s\n": (2, 10, "write '|belt.speed| < 3 mm/s'"),
    "t:\n  text: > 3 mm\n": (2, 9, "write '> 3 mm'"),
    "doc: note: this\n": (1, 10, "quote text that contains ': '"),
    "a:\n\tb: 1\n": (2, 1, "a tab is not allowed here"),
    "a: 'b\nc: d\n": (1, 4, "this quote is not closed"),
    'a: "b\nc: d\n': (1, 4, "this quote is not closed"),
    "a: 'b' c\n": (1, 8, "after a closed quote"),
    "a: {b: 1\nc: 2\n": (2, 2, "a bracket or brace of line 1 is not closed"),
    "a: [1, 2\nc: 3\n": (2, 2, "a bracket or brace of line 1 is not closed"),
    "a: {b: 1 c: 2}\n": (1, 11, "a comma is missing"),
    "a: {b: ${x}}\n": (1, 9, "quote references"),
    "a: %b\n": (1, 4, "quote it: '%b'"),
    "a: @it's\n": (1, 4, "quote it: '@it''s'"),
    "a: * b\n": (1, 4, "quote it: '* b'"),
    "a: *b\n": (1, 4, "anchors and aliases"),
    "a: !<\n": (1, 4, "quote it: '!<'"),
    'a: "\\d"\n': (1, 6, "use single quotes"),
    "a: 1\na: 2\n": (2, 1, "key 'a' is given twice; first in line 1"),
    "a: - b\n": (1, 4, "a list item '- ' cannot begin here"),
    "- a\nb: 1\n": (2, 1, "does not continue the block"),
    "a: ]\n": (1, 4, "a value is missing"),
    "a: 1\n...\nb: 2\n": (3, 1, "a second document begins here"),
}


def problem_of(text: str) -> ConfigError | None:
    try:
        parse_document(text, FILE)
    except ConfigError as error:
        return error
    return None


@pytest.mark.parametrize("text", MISTAKES)
def test_mistake_is_named_with_its_place_and_cure(text: str) -> None:
    error = problem_of(text)
    assert error is not None
    assert error.place is not None
    line, column, told = MISTAKES[text]
    assert (error.place.line, error.place.column) == (line, column), str(error)
    assert told in str(error)
    assert error.hint


PIECES = (
    *"{}[]:,#&*!|>'\"%@`?-~\t\n $\\",
    "\n- ",
    ": ",
    "- ",
    "\n  ",
    "\n\n ",
    "|x",
    "---\n",
    '"\\x',
)


@pytest.mark.parametrize(
    ("folder", "file"), [("procedures", "quick.yaml"), ("configs", "sim_lugre.yaml")]
)
def test_yaml_parser_terms_never_reach_messages(folder: Kind, file: str) -> None:
    rng = random.Random(f"{folder}/{file}")
    whole = (shipped_folder(folder) / file).read_text("utf-8")
    found = 0
    for _ in range(400):
        begin = rng.randrange(len(whole) - 300)
        text = whole[begin : begin + 300]
        for _ in range(rng.randrange(1, 4)):
            at = rng.randrange(len(text))
            text = text[:at] + rng.choice(PIECES) + text[at + rng.choice((0, 0, 1, 5)) :]
        error = problem_of(text)
        if error is not None:
            found += 1
            assert error.hint, text
            assert not JARGON.search(f"{error.message} {error.hint}"), str(error)
    assert found > 200
