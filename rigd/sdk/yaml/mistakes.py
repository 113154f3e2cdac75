"""Explains YAML mistakes in the words of a rig file instead of the words of the parser."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, Literal

from ruamel.yaml.error import MarkedYAMLError

from rigd.model.errors import ConfigError, Place


@dataclass(frozen=True)
class Mistake:
    """A message of the parser, and the message that replaces it.

    ``at`` selects the place: where the parser stopped, or where the construct began. ``{...}`` are
    the groups of ``pattern``, ``{rest}`` is the text from that place to the end of its line,
    ``{begin}`` and ``{column}`` are the line and column where the construct began.
    """

    pattern: str
    message: str
    hint: str
    at: Literal["problem", "context"] = "problem"


_FLOW: Final = "a bracket or brace of line {begin} is not closed, or a comma is missing before this"
_FLOW_HINT: Final = "close it, or separate the items by ', '; quote text that holds , [ ] {{ or }}"
_QUOTE: Final = "this quote is not closed"
_QUOTE_HINT: Final = "close it; inside '…' a quote is written twice: ''"
_EXTRA: Final = (
    "text that begins with '{first}' has a special meaning in YAML, which is not allowed here"
)
_EXTRA_HINT: Final = "quote it: '{rest}'"
_INDENT_HINT: Final = (
    "keys of the same mapping begin in the same column; the content of a key is indented further"
)

#: The first pattern that matches counts; the text is the construct, a semicolon, and the problem.
MISTAKES: Final = (
    Mistake(r"\\t'", "a tab is not allowed here", "indent with spaces"),
    Mistake(r"block scalar.*(expected|but found)",
            "text after '{opens}' begins in the next line; a condition or text that begins "
            "with '{opens}' must be quoted", "write '{opened}'", "context"),
    Mistake(r"in a block scalar", "this line is indented further than the first line of its "
                                  "text",
            "indent all lines of a text equally"),
    Mistake(r"quoted scalar.*(end of stream|document separator)", _QUOTE, _QUOTE_HINT, "context"),
    Mistake(r"double-quoted scalar.*(escape|hex|but found)",
            "a backslash has a special meaning inside double quotes",
            r"use single quotes: 'a\b', or write \\"),
    Mistake(r"simple key.*could not find expected", "this line has no ': ' after its key",
            "write 'key: value', with a space after the colon", "context"),
    Mistake(r"mapping values are not allowed", "a second ': ' in one value, or a line that is "
            "indented too far", "quote text that contains ': ', put a space after the colon "
                                "of the line above, or check the indentation"),
    Mistake(r"mapping keys are not allowed", "'?' is not allowed here", "quote text with '?'"),
    Mistake(r"sequence entries are not allowed", "a list item '- ' cannot begin here",
            "begin each item in its own line, or write [a, b]"),
    Mistake(r"flow (mapping|sequence).*(found|got) '\{'", "a brace inside braces",
            "inside braces, quote references: {{speed: '${{speed}}'}}"),
    Mistake(r"flow |unclosed", _FLOW, _FLOW_HINT),
    Mistake(r"but found '<scalar>'", "text continues after a closed quote",
            "quote all of it, or none"),
    Mistake(r"block (mapping|collection).*expected <block end>",
            "this line does not continue the block that begins in line {begin}, column "
            "{column}", _INDENT_HINT),
    Mistake(r"cannot start any token", "text cannot begin with '{first}'", _EXTRA_HINT),
    Mistake(r"(an? (anchor|alias)|scanning an)\b", _EXTRA, _EXTRA_HINT, "context"),
    Mistake(r"\btag\b", _EXTRA, _EXTRA_HINT, "context"),
    Mistake(r"directive|incompatible YAML", "a line that begins with '%' is not allowed",
            "remove it, or quote the text"),
    Mistake(r"node content", "a value is missing before this", "write a value, or remove the key"),
    Mistake(r"document (start|end)", "this line does not belong to the lines above it",
            "a file is one list of 'key: value' lines; " + _INDENT_HINT),
)  # fmt: skip
_ANY: Final = Mistake(
    "", "this cannot be read as YAML",
    "check the quotes, brackets, colons and indentation of this line and of the line above it",
)  # fmt: skip


def explain(error: MarkedYAMLError, text: str, last: Place) -> ConfigError:
    """Return the problem of ``text`` at the place where the parser raised ``error``.

    ``last`` is the last token, whose place is used if the error has no place.
    """
    message_of_parser = f"{error.context or ''}; {error.problem or ''}"
    mistake = next(
        (item for item in MISTAKES if re.search(item.pattern, message_of_parser, re.S)), _ANY
    )
    problem = error.problem_mark or error.context_mark
    context = error.context_mark or error.problem_mark
    mark = context if mistake.at == "context" else problem
    if mark is None or context is None:
        return ConfigError(_ANY.message, place=last, hint=_ANY.hint)
    lines = text.split("\n")
    line = lines[mark.line] if mark.line < len(lines) else ""
    rest = line[mark.column :].strip()
    opened = re.search(r"[|>].*", line)
    words = {
        "rest": rest.replace("'", "''"),
        "first": rest[:1],
        "opens": opened[0][0] if opened else "|",
        "opened": opened[0].strip().replace("'", "''") if opened else "|",
        "begin": context.line + 1,
        "column": context.column + 1,
    }
    place = Place(last.file, mark.line + 1, mark.column + 1)
    return ConfigError(
        mistake.message.format(**words), place=place, hint=mistake.hint.format(**words)
    )
