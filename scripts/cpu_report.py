"""Sum up what ``pytest --cpu-report FILE`` has written: CPU seconds by folder and by file."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

#: Lines of the table of files.
FILES = 40


def table(title: str, cpu: Counter[str], wall: Counter[str], most: int | None = None) -> str:
    """Return a table of the largest."""
    rows = [f"| {title} | CPU s | wall s |", "|---|---:|---:|"]
    rows += [
        f"| {name} | {spent:.1f} | {wall[name]:.1f} |" for name, spent in cpu.most_common(most)
    ]
    return "\n".join(rows)


def summary(lines: list[str]) -> str:
    """Return the tables: by folder, and the files that take the most."""
    cpu: dict[str, Counter[str]] = {"folder": Counter(), "file": Counter()}
    wall: dict[str, Counter[str]] = {"folder": Counter(), "file": Counter()}
    total = 0.0
    for line in lines:
        spent, lasted, name = line.rstrip("\n").split("\t", 2)
        total += float(spent)
        file = name.split("::")[0].removeprefix("tests/")
        for by, key in (("folder", file.split("/")[0]), ("file", file)):
            cpu[by][key] += float(spent)
            wall[by][key] += float(lasted)
    tables = (
        table("folder", cpu["folder"], wall["folder"]),
        table("file", cpu["file"], wall["file"], FILES),
    )
    return "\n\n".join((f"{total:.0f} CPU seconds", *tables))


if __name__ == "__main__":
    sys.stdout.write(summary(Path(sys.argv[1]).read_text("utf-8").splitlines()) + "\n")
