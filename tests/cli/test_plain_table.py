"""A table that fits is printed without Rich; any other one is left to it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from rigd.cli.views.plain_table import plain_table

ROWS = [("a.mcap", "10"), ("longer.mcap", "9")]


def test_columns_are_aligned_and_numbers_right() -> None:
    text = plain_table(("name", "trials"), ROWS, {1})
    assert text == "name         trials\na.mcap           10\nlonger.mcap       9"


@pytest.mark.parametrize("cell", ["磨耗", "µ", "two\nlines", "x\x1b[31m", "y" * 400])
def test_table_that_may_not_fit_is_refused(cell: str) -> None:
    assert plain_table(("name", "trials"), [*ROWS, (cell, "1")], {1}) is None


def test_search_of_recordings_loads_neither_rich_nor_numpy(tmp_path: Path) -> None:
    """Its time is that of its start: 0.07 s of the processor are Rich's, as much numpy's."""
    code = (
        "import sys; from rigd.cli.main import main; "
        f"main(['runs', {str(tmp_path)!r}, '--where', 'state == complete']); "
        "sys.exit(str({'rich', 'numpy'} & {*sys.modules}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == "set()"
