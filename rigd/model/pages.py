"""Defines the names of the HTML pages that rigd writes beside a recording."""

from __future__ import annotations

from pathlib import Path


def page_of(recording: Path) -> Path:
    """Return the path of the page of a run; the report of its analysis ends in ``.html`` only."""
    return recording.with_name(f"{recording.stem}-run.html")
