"""Names of the pages that stand beside a recording."""

from __future__ import annotations

from pathlib import Path


def page_of(recording: Path) -> Path:
    """Return where the page of a run stands; that of its identification ends in ``.html`` alone."""
    return recording.with_name(f"{recording.stem}-run.html")
