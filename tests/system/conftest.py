"""What several tests of the whole share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from support.commands.terminal import Terminal


@pytest.fixture
def open_terminal(tmp_path: Path) -> Iterator[Callable[..., Terminal]]:
    """Return what starts ``rigd run`` on a terminal of its own; it records to run.mcap."""
    opened: list[Terminal] = []

    def open_it(*arguments: str) -> Terminal:
        opened.append(Terminal.open(["run", *arguments, "--output", "run.mcap"], tmp_path))
        return opened[-1]

    yield open_it
    for item in opened:
        item.close()
