"""Reads the notes that were added to a recording after its run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

#: Metadata record of the notes: the time of each as its key, author and text as JSON.
NOTES_METADATA: Final = "notes"


@dataclass(frozen=True)
class Note:
    """A note; ``at`` is ISO 8601 in UTC."""

    at: str
    author: str
    text: str

    def __str__(self) -> str:
        return f"{self.text} ({self.author}, {self.at[:16].replace('T', ' ')})"


def note_content(note: Note) -> str:
    """Return the value that stands in the metadata for a note."""
    return json.dumps({"author": note.author, "text": note.text}, ensure_ascii=False)


def notes_in(metadata: Mapping[str, Mapping[str, str]]) -> tuple[Note, ...]:
    """Return the notes that were added to a recording, the oldest first."""
    found = []
    for at, content in sorted(metadata.get(NOTES_METADATA, {}).items()):
        with suppress(ValueError):  # of another program
            data = json.loads(content)
            if isinstance(data, dict):
                found.append(Note(at, str(data.get("author", "")), str(data.get("text", ""))))
    return tuple(found)
