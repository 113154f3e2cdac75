"""What commands give of a run, without what is of its file: to compare files of the same run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from support.commands.command import rigd

#: What is of the file, not of the run in it.
OF_FILE = {
    "recording", "file", "writer", "lacks", "unread", "doubled", "bytes", "path", "sha256", "size",
    "condition", "files", "recordings", "attachments",
}  # fmt: skip


def of_run(value: Any) -> Any:
    """Return a result of a command without what is of the file."""
    if isinstance(value, dict):
        return {name: of_run(item) for name, item in value.items() if name not in OF_FILE}
    return [of_run(item) for item in value] if isinstance(value, list) else value


def shown(path: Path, other: Path) -> Any:
    return rigd("info", path, "--json", cwd=path.parent).json


def listed(path: Path, other: Path) -> Any:
    return rigd("runs", path.parent, "--json", cwd=path.parent).json


def measured(path: Path, other: Path) -> Any:
    return rigd("measure", path, "--json", cwd=path.parent).json


def compared(path: Path, other: Path) -> Any:
    return rigd("compare", other, path, "--json", cwd=path.parent).json


def drawn(path: Path, other: Path) -> list[str]:
    """Return the lines of the page up to the attached files, without its date and its size."""
    page = path.with_name("page.html")
    rigd("report", path, "--output", page, cwd=path.parent)
    lines = page.read_text().partition("<details>")[0].splitlines()
    page.unlink()
    return [line for line in lines if not ("Size of the file" in line or "Report made" in line)]


#: Each with a recording, and another one of the same procedure.
COMMANDS: dict[str, Callable[[Path, Path], Any]] = {
    "info": shown, "runs": listed, "measure": measured, "compare": compared,
    "report": drawn,
}  # fmt: skip
