"""Writes a renewed calibration file: new values, others unchanged, replaced ones kept.

The file is data: what is kept of it is the text of each value, and the comment at its head. A
comment elsewhere is lost; ``from:`` is the place for a reason.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import date
from io import StringIO
from pathlib import Path
from typing import Any, Final

from ruamel.yaml import YAML

from rigd.config.calibratable import calibratable
from rigd.config.calibration import CalibratedValue, Calibration, parse_calibration
from rigd.config.document import parse_document
from rigd.model.errors import ConfigError
from rigd.model.units import parse_unit

#: A value is written with so many digits more than its uncertainty has, which has two.
_GUARD_DIGITS: Final = 1
_DAYS: Final = ("made", "valid_until", "replaced")
_NUMBERS: Final = ("value", "u")
_NEW_HEAD: Final = """\
# What was measured of this rig. Written by `rigd calibrate`, which keeps this comment and no other.
"""


def renewed(
    old: Calibration | None,
    values: Mapping[str, CalibratedValue],
    *,
    name: str,
    rigs: Sequence[str],
    path: Path,
    on: date,
) -> Calibration:
    """Return ``old`` with ``values`` in place of its own, as the text that ``path`` shall hold.

    What they replace goes to the history, as replaced ``on`` that day. Without an ``old`` one the
    calibration is called ``name`` and belongs to ``rigs``.

    Raises:
        ConfigError: a value cannot stand in a calibration, such as a scale below zero.
    """
    data: dict[str, Any] = {"calibration": name, "rigs": list(rigs), "values": {}, "history": []}
    head = _NEW_HEAD
    if old is not None:
        written: Any = parse_document(old.text, old.path).data
        data |= written
        head = _head(old.text)
    history = [
        {"name": item, **data["values"][item], "replaced": on.isoformat()}
        for item in values
        if item in data["values"]
    ]
    data["history"] = [*history, *data["history"]]
    merged = data["values"] | {item: _block(value) for item, value in values.items()}
    data["values"] = {item: merged[item] for item in calibratable() if item in merged}
    if not data["history"]:
        del data["history"]
    text = StringIO()
    yaml = YAML()
    yaml.width = 100
    yaml.representer.ignore_aliases = lambda _: True  # one day may stand in several places
    yaml.dump(_plain(data), text)
    return parse_calibration(head + text.getvalue(), str(path))


def write_calibration(new: Calibration, before: str | None) -> None:
    """Write ``new`` to its path: whole or not at all, whatever happens meanwhile.

    ``before`` is the text that stood there when it was renewed, None where there was no file.

    Raises:
        ConfigError: somebody else has changed the file since, or it cannot be written.
    """
    path = new.path
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        found = path.read_text("utf-8") if path.exists() else None
        if found != before:
            raise ConfigError(
                f"{path} has changed since it was read; nothing is written",
                hint="look at it, then `rigd calibrate --from RECORDING` once more",
            )
        _replace(path, new.text)
    except OSError as error:
        raise ConfigError(
            f"{path} cannot be written: {error.strerror}", hint="give --write another FILE"
        ) from error


def _replace(path: Path, text: str) -> None:
    """Put ``text`` in place of the file at once: a reader sees the old one or the new one."""
    number, beside = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(number, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fchmod(number, path.stat().st_mode & 0o777 if path.exists() else 0o644)
            os.fsync(number)
        Path(beside).replace(path)
    except BaseException:
        with suppress(FileNotFoundError):
            Path(beside).unlink()
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)  # the new name too survives a loss of power
    finally:
        os.close(folder)


def _head(text: str) -> str:
    """Return the lines of comment, and blank ones, that stand before the first key."""
    lines = text.splitlines(keepends=True)
    first = next(
        (at for at, line in enumerate(lines) if line.strip() and not line.startswith("#")),
        len(lines),
    )
    return "".join(lines[:first])


def _block(value: CalibratedValue) -> dict[str, Any]:
    """Return a value as its keys stand in the file."""
    places = _places(value.u / parse_unit(value.unit).factor)
    block: dict[str, Any] = {
        "value": _quantity(value.value, value.unit, places),
        "u": _quantity(value.u, value.unit, places),
        "source": value.source,
        "from": value.origin,
        "made": value.made.isoformat(),
        "operator": value.operator,
    }
    if value.valid_until is not None:
        block["valid_until"] = value.valid_until.isoformat()
    if value.instruments:
        block["instruments"] = dict(value.instruments)
    return block


def _places(u: float) -> int:
    """Return the decimals that two digits of ``u`` and a guard need; many where it is 0."""
    if not u:
        return 9
    first = f"{u:e}".partition("e")[2]
    return max(0, 1 + _GUARD_DIGITS - int(first))


def _quantity(value: float, unit: str, places: int) -> str:
    symbol = "" if unit == "1" else f" {unit}"
    return f"{value / parse_unit(unit).factor:.{places}f}{symbol}"


def _plain(data: Any, key: str = "") -> Any:
    """Return ``data`` with days and numbers as such: YAML writes them without quotation marks."""
    if isinstance(data, list):
        return [_plain(item) for item in data]
    if isinstance(data, dict) and key != "instruments":  # whose devices are called as they like
        return {name: _plain(item, name) for name, item in data.items()}
    if isinstance(data, str) and key in _DAYS:
        return date.fromisoformat(data)
    if isinstance(data, str) and key in _NUMBERS:
        number = YAML().load(data)  # which remembers how it was written: 0.990, 1.5e-4
        return number if isinstance(number, int | float) else data
    return data
