"""A function that imports a text."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.recordings.imported import MAP, Import

from rigd.importing import import_files, parse_map
from rigd.record import Recording


@pytest.fixture
def bring_in(tmp_path: Path) -> Import:
    """Imports ``text`` as the file ``name``; ``options`` of the text replace those of the map."""

    def make(
        text: str | bytes,
        options: str = "{}",
        *,
        map: str = MAP,
        more: str = "",
        name: str = "old.csv",
    ) -> Recording:
        file = tmp_path / name
        file.write_bytes(text.encode() if isinstance(text, str) else text)
        written = map.replace("text: {}", f"text: {options}") + more
        what = parse_map(written, Path("map.yaml"))
        (made,) = import_files(what, [file], tmp_path / "runs")
        return Recording.open(made.path)

    return make
