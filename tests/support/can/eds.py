"""The EDS of the simulated servo, changed by a test: ``{"6071/AccessType": "ro"}``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

SHIPPED = Path(__file__).parents[3] / "configs" / "eds"
#: Of the scripted nodes, which do not report their product and revision.
VENDOR = {"DeviceInfo/VendorNumber": "0xFB"}


def write_eds(path: Path, changes: Mapping[str, str | None], kind: str = "servo") -> Path:
    """Write the shipped EDS with ``changes`` to ``path``; None removes a value, or a section."""
    text = (SHIPPED / f"rigd_{kind}.eds").read_text("ascii")
    for where, value in {**VENDOR, **changes}.items():
        name, _, key = where.partition("/")
        head, section, rest = re.split(
            rf"(^\[{re.escape(name)}\]\n(?:[^\[\n].*\n|\n)*)", text, maxsplit=1, flags=re.M
        )
        text = head + _changed(section, key, value) + rest
    path.write_text(text, "ascii")
    return path


def line_of(path: Path, section: str, key: str = "") -> int:
    """Return the line in which a section of the file, or a value in it, stands."""
    lines = path.read_text("latin-1").split("\n")
    line = lines.index(f"[{section}]")
    if key:
        line = next(n for n in range(line, len(lines)) if lines[n].startswith(f"{key}="))
    return line + 1


def _changed(section: str, key: str, value: str | None) -> str:
    if not key:
        return ""
    line = re.compile(rf"^{key}=.*\n", re.M)
    if value is None:
        return line.sub("", section)
    new = f"{key}={value}\n"
    return line.sub(new, section) if line.search(section) else section.rstrip("\n") + f"\n{new}\n"
