"""Sum up what ``pytest --cpu-report=FILE`` has written: CPU seconds by folder and by file."""

from __future__ import annotations

import sys
from pathlib import Path

#: Lines of the table of files.
FILES = 40


def table(title: str, spent: dict[str, list[float]], most: int | None = None) -> str:
    """Return a table of those that take the most: name, CPU seconds, wall seconds."""
    largest = sorted(spent.items(), key=lambda row: -row[1][0])[:most]
    rows = [f"| {title} | CPU s | wall s |", "|---|---:|---:|"]
    rows += [f"| {name} | {cpu:.1f} | {wall:.1f} |" for name, (cpu, wall) in largest]
    return "\n".join(rows)


def summary(lines: list[str]) -> str:
    """Return the tables: by folder, and the files that take the most."""
    folders: dict[str, list[float]] = {}
    files: dict[str, list[float]] = {}
    for line in lines:
        cpu, wall, name = line.rstrip("\n").split("\t", 2)
        file = name.split("::")[0].removeprefix("tests/")
        for spent, key in ((folders, file.split("/")[0]), (files, file)):
            sums = spent.setdefault(key, [0.0, 0.0])
            sums[0] += float(cpu)
            sums[1] += float(wall)
    total = sum(cpu for cpu, _ in folders.values())
    return "\n\n".join(
        (f"{total:.0f} CPU seconds", table("folder", folders), table("file", files, FILES))
    )


if __name__ == "__main__":
    sys.stdout.write(summary(Path(sys.argv[1]).read_text("utf-8").splitlines()) + "\n")
