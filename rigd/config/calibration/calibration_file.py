"""Writes a renewed calibration file: new values, unchanged values, and replaced values.

The module keeps the text of each value and the comment at the head of the file. Any other comment
is lost; write a reason in ``from:`` instead.
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

from rigd.config.calibration.calibratable import calibratable
from rigd.config.calibration.calibration import CalibratedValue, Calibration, parse_calibration
from rigd.config.document import parse_document
from rigd.model.errors import ConfigError
from rigd.model.machine.system import copy_mode, sync_folder
from rigd.model.units import parse_unit

#: A value is written with this number of digits more than its uncertainty, which has two.
_GUARD_DIGITS: Final = 1
_DAYS: Final = ("made", "valid_until", "replaced")
_NUMBERS: Final = ("value", "u")
_NEW_HEAD: Final = """\
# Measured values of this rig. Written by `rigd calibrate`, which keeps this comment and no other.
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
    """Return ``old`` with ``values`` instead of its own values, as the text for ``path``.

    Replaced values move to the history, with the day ``on``. Without an ``old`` calibration the
    name is ``name`` and the rigs are ``rigs``.

    Raises:
        ConfigError: a value is not allowed in a calibration, such as a scale below zero.
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
    yaml.representer.ignore_aliases = lambda _: True  # a day may be in several places
    yaml.dump(_plain(data), text)
    return parse_calibration(head + text.getvalue(), str(path))


def write_calibration(new: Calibration, before: str | None) -> None:
    """Write ``new`` to its path: completely or not at all.

    ``before`` is the text of the file when it was renewed, None if there was no file.

    Raises:
        ConfigError: the file has changed since, or it cannot be written.
    """
    path = new.path
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # As a file is read: with its line ends, without the mark of its byte order.
        found = path.read_bytes().decode("utf-8-sig", "replace") if path.exists() else None
        if found != before:
            raise ConfigError(
                f"{path} has changed since it was read; nothing is written",
                hint="check the file, then run `rigd calibrate --from RECORDING` again",
            )
        _replace(path, new.text)
    except OSError as error:
        raise ConfigError(
            f"{path} cannot be written: {error.strerror}", hint="give --write another FILE"
        ) from error


def _replace(path: Path, text: str) -> None:
    """Replace the file by ``text`` in one step: a reader sees the old or the new text."""
    number, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(number, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            copy_mode(number, path.stat().st_mode if path.exists() else 0o644)
            os.fsync(number)
        Path(temporary).replace(path)
    except BaseException:
        with suppress(FileNotFoundError):
            Path(temporary).unlink()
        raise
    sync_folder(path.parent)  # the new name also survives a loss of power


def _head(text: str) -> str:
    """Return the lines of comment, and blank lines, before the first key."""
    lines = text.splitlines(keepends=True)
    first = next(
        (at for at, line in enumerate(lines) if line.strip() and not line.startswith("#")),
        len(lines),
    )
    return "".join(lines[:first])


def _block(value: CalibratedValue) -> dict[str, Any]:
    """Return the keys of a value for the file."""
    unit = parse_unit(value.unit)
    difference = unit.difference()
    places = _places(value.u / difference.factor)
    block: dict[str, Any] = {
        "value": _quantity(unit.from_si(value.value), unit.symbol, places),
        "u": _quantity(value.u / difference.factor, difference.symbol, places),
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
    """Return the number of decimals for two digits of ``u`` and a guard; many if ``u`` is 0."""
    if not u:
        return 9
    first = f"{u:e}".partition("e")[2]
    return max(0, 1 + _GUARD_DIGITS - int(first))


def _quantity(number: float, unit: str, places: int) -> str:
    symbol = "" if unit == "1" else f" {unit}"
    return f"{number:.{places}f}{symbol}"


def _plain(data: Any, key: str = "") -> Any:
    """Return ``data`` with days and numbers as such: YAML writes them without quotation marks."""
    if isinstance(data, list):
        return [_plain(item) for item in data]
    if isinstance(data, dict) and key != "instruments":  # its devices may have any name
        return {name: _plain(item, name) for name, item in data.items()}
    if isinstance(data, str) and key in _DAYS:
        return date.fromisoformat(data)
    if isinstance(data, str) and key in _NUMBERS:
        number = YAML().load(data)  # keeps the form of a number: 0.990, 1.5e-4
        return number if isinstance(number, int | float) else data
    return data
