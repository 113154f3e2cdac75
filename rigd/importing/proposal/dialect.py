"""Finds out how a text file is written: encoding, separator, decimal sign, where its table lies."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rigd.importing.tables.table import parse_file_unit
from rigd.model.errors import ConfigError

#: Text that is looked at, in bytes.
SAMPLE_BYTES: Final = 1 << 20
#: Texts that mean that there is no value.
MISSING: Final = ("", "NaN", "nan", "NAN", "NA", "N/A", "#N/A", "null", "NULL", "None", "-", "--")
#: What parts cells, the first that fits as well as any; the first three need not be stated.
_SEPARATORS: Final = {"tab": "\t", ";": ";", ",": ",", "|": "|", "space": " "}
_UNSTATED: Final = ("tab", ";", ",")
_POINT: Final = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_COMMA: Final = re.compile(r"[-+]?(?:\d+,?\d*|,\d+)(?:[eE][-+]?\d+)?")


@dataclass(frozen=True)
class Dialect:
    """How a text file is written.

    ``options`` are those of `text:` in a map, ``notes`` say why. ``rows`` are cells of the first
    lines of data, numbers with a decimal point. ``asked`` is the option that is to be filled in,
    and why.
    """

    options: dict[str, object]
    notes: Sequence[str]
    rows: Sequence[Sequence[str]]
    asked: tuple[str, str] = ("", "")


def sniff(path: Path) -> Dialect:
    """Return how the text file at ``path`` is written, from its first MiB.

    Raises:
        ConfigError: the file cannot be read, or no two lines are rows of a table.
    """
    encoding, lines = _lines(path)
    found = [item for item in (_table(lines, name) for name in _SEPARATORS) if item is not None]
    if not found:
        raise ConfigError(f"{path}: no two lines one after the other are rows with numbers")
    table = max(found, key=lambda item: item.score)
    options: dict[str, object] = {}
    notes = []
    named = lines[(table.header or table.first) - 1]
    default = next((name for name in _UNSTATED if _SEPARATORS[name] in named), ",")
    if table.separator != default:
        options["separator"] = table.separator
    if table.decimal == ",":
        options["decimal"] = ","
    if encoding != "utf-8":
        options["encoding"] = encoding
    if encoding == "latin-1":
        notes.append("the text is not UTF-8, and is taken for latin-1: check letters such as µ, °")
    if table.header != 1:
        options["header"] = table.header
    if table.units:
        options["units"] = table.units
    if table.first != max(table.header, table.units) + 1:
        options["first"] = table.first
    if not table.header:
        notes.append(f"line {table.first} has no names of columns: they go by their numbers")
    asked = ("", "")
    if table.above:
        key = "header" if table.header else "first"
        options.setdefault(key, table.first)
        asked = (key, f"{table.above} lines above are rows of numbers, too: of another table?")
    return Dialect(options, notes, table.rows, asked)


def number(text: str) -> float | None:
    """Return a number with a decimal point, or None if ``text`` is none."""
    plain = text.strip()
    return float(plain) if _POINT.fullmatch(plain) else None


@dataclass(frozen=True)
class _Table:
    separator: str
    decimal: str
    header: int
    units: int
    first: int
    rows: Sequence[Sequence[str]]
    score: float
    above: int  #: lines above its names that are rows of numbers, too


def _lines(path: Path) -> tuple[str, list[str]]:
    """Return the encoding and the first lines, whole ones."""
    try:
        with path.open("rb") as file:
            raw = file.read(SAMPLE_BYTES)
            cut = bool(file.read(1))
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    encoding = "utf-8"
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding, text = "utf-16", raw[: len(raw) // 2 * 2].decode("utf-16", "replace")
    else:
        end = max(raw.rfind(b"\n"), raw.rfind(b"\r")) + 1
        whole = raw[:end] if cut and end else raw
        try:
            text = whole.decode("utf-8-sig")
        except UnicodeDecodeError:
            encoding, text = "latin-1", whole.decode("latin-1")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if cut:
        lines.pop()
    while lines and not lines[-1].strip():
        lines.pop()
    return encoding, lines


def _table(lines: Sequence[str], separator: str) -> _Table | None:
    """Return the longest table that the lines have with a separator between cells."""
    cells = [_cells(line, separator) for line in lines]
    comma = separator != ","
    numeric = [sum(map(_is_number if comma else _is_pointed, row)) for row in cells]
    begin, end = _longest(cells, numeric)
    if end - begin < 2:
        return None
    count = len(cells[begin])
    # The first row may have a word in the column of comments that the others lack, as of LabVIEW.
    if begin and len(cells[begin - 1]) == count + 1 and numeric[begin - 1] == numeric[begin]:
        begin -= 1
    rows = [row[:count] for row in cells[begin:end]]
    decimals = [cell for row in rows for cell in row if "," in cell and _COMMA.fullmatch(cell)]
    points = any("." in cell and _POINT.fullmatch(cell) for row in rows for cell in row)
    decimal = "," if comma and decimals and not points else "."
    if decimal == ",":
        rows = [[_with_point(cell) for cell in row] for row in rows]
    share = sum(numeric[begin:end]) / ((end - begin) * count)
    header, units = _names(cells, numeric, begin, count)
    score = sum(numeric[begin:end]) * share
    top = (header or begin + 1) - 1
    above = sum(numeric[at] == len(cells[at]) for at in range(top) if len(cells[at]) > 1)
    return _Table(separator, decimal, header, units, begin + 1, rows, score, above)


def _longest(cells: Sequence[Sequence[str]], numeric: Sequence[int]) -> tuple[int, int]:
    """Return the first line of the longest run of rows with numbers, and the one after it."""
    best, begin = (0, 0), 0
    for at in range(len(cells) + 1):
        goes_on = (
            at < len(cells)
            and (len(cells[at]) == len(cells[begin]) or at == begin)
            and (numeric[at] or (at > begin and _is_empty(cells[at])))
        )
        if goes_on:
            continue
        if at - begin > best[1] - best[0]:
            best = (begin, at)
        begin = at if at < len(cells) and numeric[at] else at + 1
    return best


def _is_empty(row: Sequence[str]) -> bool:
    return len(row) > 1 and all(cell in MISSING for cell in row)


def _names(
    cells: Sequence[Sequence[str]], numeric: Sequence[int], begin: int, count: int
) -> tuple[int, int]:
    """Return the lines of names and of units, from 1; 0 if there is none."""
    above = [at for at in range(begin) if any(cells[at])][-2:]
    if not above or len(cells[above[-1]]) < count or numeric[above[-1]]:
        return 0, 0
    last = above[-1]
    if len(above) > 1 and len(cells[above[0]]) == len(cells[last]) and _are_units(cells[last]):
        return above[0] + 1, last + 1
    return last + 1, 0


def _are_units(row: Sequence[str]) -> bool:
    known = [cell for cell in row if cell and cell not in MISSING]
    return bool(known) and all(_is_unit(cell.strip("[]()").strip()) for cell in known)


def _is_unit(text: str) -> bool:
    try:
        parse_file_unit(text)
    except ValueError:
        return False
    return True


def _cells(line: str, separator: str) -> list[str]:
    if separator == "space":
        return line.split()
    try:
        row = next(csv.reader([line], delimiter=_SEPARATORS[separator]), [""])
    except csv.Error:
        return [line]
    return [cell.strip() for cell in row]


def _is_pointed(cell: str) -> bool:
    return _POINT.fullmatch(cell) is not None


def _is_number(cell: str) -> bool:
    return _POINT.fullmatch(cell) is not None or _COMMA.fullmatch(cell) is not None


def _with_point(cell: str) -> str:
    return cell.replace(",", ".") if _COMMA.fullmatch(cell) else cell
