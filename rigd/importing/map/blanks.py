"""Refuses a map with values that are still to be filled in, as `rigd import --propose` writes."""

from __future__ import annotations

from typing import Final

from rigd.config.document import Document
from rigd.config.problems import Problems

#: Stands where the user shall fill in a value.
BLANK: Final = "?"
#: The keys whose value may be missing; a name, a title or a text may be a question mark.
ASKED: Final = (
    "unit", "rate", "since", "format", "restarts", "wraps", "coarse", "longest_gap", "zone",
    "open_end", "last", "missing", "decimal", "encoding", "header", "first", "gaps", "warnings",
)  # fmt: skip


def note_blanks(document: Document, problems: Problems) -> None:
    """Note each value of ``document`` that is still to be filled in."""
    for path in document.values:
        if path and path[-1] in ASKED and document.get(path) == BLANK:
            problems.add(
                document.place(path),
                f"`{path[-1]}:` is still to be filled in",
                "the comment behind it says what is not known; write the value in its place",
            )
