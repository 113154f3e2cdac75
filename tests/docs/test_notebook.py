"""The notebook of the documentation holds what its cells give."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

NOTEBOOK = Path(__file__).resolve().parents[2] / "docs" / "notebook.ipynb"
JUPYTER = Path(sys.executable).parent / "jupyter"


def shown(file: Path) -> list[list[dict[str, Any]]]:
    """Return the outputs of each cell: what it printed, and the kinds of its tables and plots."""
    cells = json.loads(file.read_text("utf-8"))["cells"]
    return [
        [
            {"text": "".join(output["text"])}
            if output["output_type"] == "stream"
            else {"kinds": sorted(set(output["data"]) - {"text/plain"})}
            for output in cell["outputs"]
        ]
        for cell in cells
        if cell["cell_type"] == "code"
    ]


def test_cells_give_what_the_page_shows(tmp_path: Path) -> None:
    copy = tmp_path / NOTEBOOK.name
    copy.write_bytes(NOTEBOOK.read_bytes())
    command = [str(JUPYTER), "execute", "--inplace", copy.name]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert shown(copy) == shown(NOTEBOOK)
    assert any(output for output in shown(copy))
