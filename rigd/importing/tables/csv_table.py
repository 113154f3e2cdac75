"""Reads text files with columns block by block, in bounded memory; names the place of a mistake.

pyarrow parses each block of whole lines. If it refuses one, this block alone is read again line by
line, to find the first cell that is wrong.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from rigd.importing.source import TextTableSource
from rigd.importing.tables.bounds import require_columns
from rigd.importing.tables.table import Batch, Kind
from rigd.model.errors import ConfigError, Place
from rigd.model.units import odd_character

#: Text that is parsed at once, in bytes: above 4 MiB it is not parsed faster.
BLOCK_BYTES: Final = 8 << 20
#: Of a block pyarrow parses so much in one thread.
_PART_BYTES: Final = 1 << 20
_SEPARATORS: Final = {"tab": "\t", "space": " "}
_TYPES: Final = {"number": pa.float64(), "whole": pa.int64(), "text": pa.string()}
_UTF8: Final = ("utf-8", "utf8", "ascii", "utf-8-sig")
_NUMBER: Final = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_WHOLE: Final = re.compile(r"[-+]?\d+")
#: A plus before a number, which pyarrow does not read: loggers write `+1.5E-03`.
_PLUS: Final = re.compile(rb"(?m)(^|[,;\t| \"])\+(?=[0-9.,])")
#: A line end of old Macs and of some instruments.
_LONE_CR: Final = re.compile(rb"\r(?!\n)")
_SPACES: Final = re.compile(rb"[ \t]+")
#: The column of LabVIEW in which a row, most often the first, may have words.
_COMMENT: Final = "Comment"
_EDGES: Final = re.compile(rb"(?m)^ | \r?$")


class CsvTable:
    """One text file; see :class:`rigd.importing.tables.table.SourceTable`."""

    def __init__(self, path: Path, text: TextTableSource) -> None:
        """Read the lines before the data.

        Raises:
            ConfigError: the file cannot be read, is empty, or its names cannot be.
        """
        self._path = path
        self._text = text
        self._first_line = text.first or max(text.header, text.units) + 1
        self._drops_plus = self._drops_comments = False
        self._no_cells: list[str] = []
        head = self._head()
        named = text.header or self._first_line
        if len(head) < named:
            what = "is empty" if not head else f"ends before line {named}"
            raise ConfigError(f"the file {what}", place=self._at(max(1, len(head)), 1))
        self._separator = self._separator_of(head[named - 1])
        cells = self._cells(head[named - 1])
        require_columns(path, f"line {named}", len(cells))
        self._names = [str(index) for index in range(1, len(cells) + 1)]
        if text.header:
            self._names = [cell.strip() for cell in cells]
        self._units = [""] * len(cells)
        if text.units:
            units = self._cells(head[text.units - 1])
            if len(units) != len(cells):
                raise ConfigError(
                    f"the line has {len(units)} units, line {text.header} {len(cells)} names",
                    place=self._at(text.units, 1),
                )
            self._units = [unit.strip().strip("[]()").strip() for unit in units]
        if len(head) < self._first_line:
            raise ConfigError(
                f"the file has no data: it ends before line {self._first_line}",
                place=self._at(len(head), 1),
            )
        self._sample, *second = map(self._cells, head[self._first_line - 1 :])
        count = len(self._sample)
        if count == len(cells) and cells[-1].strip() == _COMMENT and second and second[0]:
            count = len(second[0])  # the first row has one, as LabVIEW writes it there
        if 1 < count < len(cells) and text.header:
            # LabVIEW ends its line of names with a name of which most rows have no cell.
            self._names, self._units = self._names[:count], self._units[:count]
            self._no_cells = [cell.strip() for cell in cells[count:]]
            self._sample = self._sample[:count]

    @property
    def path(self) -> Path:
        """The file."""
        return self._path

    @property
    def names(self) -> Sequence[str]:
        """The names of the columns."""
        return self._names

    @property
    def without_cells(self) -> Sequence[str]:
        """The last names, if rows of the data have no cells for them."""
        return self._no_cells

    @property
    def start_ns(self) -> int | None:
        """None: the format has no place for it."""
        return None

    def unit(self, column: int) -> str:
        """Return the unit in the line of the units."""
        return self._units[column]

    def is_whole(self, column: int) -> bool:
        """Return whether the first row has a whole number."""
        cell = self._sample[column] if column < len(self._sample) else ""
        return _WHOLE.fullmatch(cell.strip()) is not None

    def place(self, column: int, row: int | None = None) -> Place:
        """Return the line and column of a cell."""
        number = max(1, self._text.header) if row is None else self._first_line + row
        for first, block in self._blocks(1):
            if first <= number < first + block.count(b"\n"):
                line = block.split(b"\n")[number - first].decode(errors="replace")
                return self._at(number, self._start_of(line, column))
        return self._at(number, 1)

    def batches(self, wanted: Mapping[int, Kind]) -> Iterator[Batch]:
        """Yield all rows of the ``wanted`` columns, in order.

        Raises:
            ConfigError: a cell cannot be read, or the file is cut off.
        """
        row = 0
        for line, block in self._blocks(self._first_line):
            batch = self._parsed(line, block, row, wanted)
            row += batch.rows
            yield batch

    def _parsed(self, line: int, block: bytes, row: int, wanted: Mapping[int, Kind]) -> Batch:
        if self._drops_comments:
            block = self._with_comment.sub(rb"\1", block)
        if self._text.separator == "space":
            block = _EDGES.sub(b"", _SPACES.sub(b" ", block))
        try:
            table = self._read(block, wanted)
        except pa.ArrowInvalid as error:
            if self._no_cells == [_COMMENT] and not self._drops_comments:
                self._drops_comments = True
                return self._parsed(line, block, row, wanted)
            fault = self._fault(line, block, wanted)
            if fault is None and not self._drops_plus and _PLUS.search(block):
                self._drops_plus = True
                return self._parsed(line, block, row, wanted)
            raise fault or ConfigError(
                f"lines {line} to {line + block.count(10)} cannot be read: {error}",
                place=self._at(line, 1),
            ) from error
        numbers: dict[int, Any] = {}
        texts: dict[int, Any] = {}
        for index, kind in wanted.items():
            column = table.column(str(index))
            if kind == "text":
                texts[index] = column.combine_chunks()
                continue
            numbers[index] = values = column.to_numpy()
            if kind == "number" and not np.isfinite(values.sum()):
                unknown = int(np.count_nonzero(~np.isfinite(values)))
                fault = self._fault(line, block, {index: kind})
                if unknown > column.null_count and fault is not None:
                    raise fault
            if kind == "whole" and column.null_count:
                raise self._fault(line, block, {index: kind}, missing=False) or ConfigError(
                    "a time is missing", place=self._at(line, 1)
                )
        return Batch(row, table.num_rows, numbers, texts)

    def _read(self, block: bytes, wanted: Mapping[int, Kind]) -> Any:
        texts: dict[int, Kind] = {at: kind for at, kind in wanted.items() if kind == "text"}
        if not self._drops_plus or len(texts) == len(wanted):
            return self._table(block, wanted)
        numbers = {at: kind for at, kind in wanted.items() if kind != "text"}
        table = self._table(_PLUS.sub(rb"\1", block), numbers)
        if texts:  # which keep their plus
            read = self._table(block, texts)
            for name in read.column_names:
                table = table.append_column(name, read.column(name))
        return table

    def _table(self, block: bytes, wanted: Mapping[int, Kind]) -> Any:
        names = [str(index) for index in range(len(self._names))]
        return pa_csv.read_csv(
            pa.BufferReader(block),
            pa_csv.ReadOptions(column_names=names, block_size=_PART_BYTES),
            pa_csv.ParseOptions(delimiter=self._separator, ignore_empty_lines=False),
            pa_csv.ConvertOptions(
                column_types={str(index): _TYPES[kind] for index, kind in wanted.items()},
                include_columns=[str(index) for index in wanted],
                null_values=self._text.missing,
                strings_can_be_null=False,
                decimal_point=self._text.decimal,
            ),
        )

    def _fault(
        self, first: int, block: bytes, wanted: Mapping[int, Kind], *, missing: bool = True
    ) -> ConfigError | None:
        """Return the first mistake of a block that begins at line ``first``, or None."""
        for number, raw in enumerate(block.removesuffix(b"\n").split(b"\n"), first):
            try:
                line = raw.decode()
            except UnicodeDecodeError as error:
                return self._not_decoded(number, error.start + 1, raw[error.start])
            cells = self._cells(line)
            if not line.strip():
                return ConfigError(
                    "the line is empty, and others follow",
                    place=self._at(number, 1),
                    hint=f"if another table begins there, `last: {number - 1}` below `text:` ends "
                    "this one; `header:` and `first:` of another source, or of another map, begin "
                    "the next one",
                )
            if len(cells) != len(self._names):
                return ConfigError(
                    f"the line has {len(cells)} cells, expected {len(self._names)} columns",
                    place=self._at(number, self._start_of(line, min(len(cells), len(self._names)))),
                    hint="the file may be cut off there, or a text have the separator in it",
                )
            for index, kind in wanted.items():
                cell = cells[index]
                if kind == "text" or (missing and cell in self._text.missing):
                    continue
                problem = self._not_a_number(cell.strip(), kind)
                if problem:
                    message, hint = problem
                    place = self._at(number, self._start_of(line, index))
                    name = self._names[index]
                    return ConfigError(f"column {name!r}: {message}", place=place, hint=hint)
        return None

    def _not_a_number(self, cell: str, kind: Kind) -> tuple[str, str | None] | None:
        """Return what is wrong with a cell, and what to do; None if it is a number."""
        comma = self._text.decimal == ","
        plain = cell.replace(",", ".") if comma and "." not in cell else cell
        if comma and "." in cell:
            plain = ""
        if (_WHOLE if kind == "whole" else _NUMBER).fullmatch(plain):
            return None if math.isfinite(float(plain)) else (f"{cell!r} is too large", None)
        if not cell:
            return "the cell is empty", (
                "if empty cells mean that there is no value, add `missing: ['']` below `text:`; if "
                "columns have different rates, make a source of each with `sparse: true`"
            )
        if kind == "whole" and _NUMBER.fullmatch(plain):
            return f"{cell!r} is no whole number, as the first row has", None
        if problem := self.wrong_decimal(cell):
            return problem
        if odd := odd_character(cell):
            return f"{cell!r} is no number{odd}", "correct that character in the file"
        return f"{cell!r} is no number", (
            f"if it means that there is no value, add `missing: [{cell!r}]` below `text:`"
        )

    def wrong_decimal(self, cell: str) -> tuple[str, str] | None:
        """Return what is wrong with a number that has the other decimal sign, and what to do."""
        used = self._text.decimal
        sign = "." if used == "," else ","
        if sign not in cell or not _NUMBER.fullmatch(cell.replace(sign, ".")):
            return None
        return (
            f"{cell!r} has a decimal {sign!r}, and the map says {used!r}",
            f"correct the file if it mixes both signs, or the map: `decimal: '{sign}'`",
        )

    def _blocks(self, first: int) -> Iterator[tuple[int, bytes]]:
        """Yield blocks of whole lines from line ``first`` on, each with its first line's number.

        Raises:
            ConfigError: the last line has no end.
        """
        number, skip, carry = 1, first - 1, b""
        for data in self._upto_last():
            data = carry + data if carry else data
            at = 0
            while skip and (end := data.find(b"\n", at)) >= 0:
                at, number, skip = end + 1, number + 1, skip - 1
            end = data.rfind(b"\n") + 1
            if skip or end <= at:
                carry = data[at:]
                self._require_line(number, carry)
                continue
            carry, block = data[end:], data[at:end] if at or end < len(data) else data
            yield number, block
            number += block.count(b"\n")
        if not carry or skip:
            return
        if not self._text.open_end and number >= self._first_line:
            raise ConfigError(
                "the last line has no end of line: the file seems to be cut off",
                place=self._at(number, len(carry.decode(errors="replace")) + 1),
                hint="delete this line, or add `open_end: true` below `text:` if the program that "
                "wrote the file never ends the last line",
            )
        yield number, carry + b"\n"

    def _require_line(self, number: int, begin: bytes) -> None:
        if len(begin) > BLOCK_BYTES:
            raise ConfigError(
                f"the line has more than {len(begin)} bytes, so the file seems to be no table",
                place=self._at(number, 1),
            )

    def _upto_last(self) -> Iterator[bytes]:
        """Yield the text up to the last line of data, if the map states it."""
        rest = self._text.last
        for data in self._chunks():
            if rest and (count := data.count(b"\n")) >= rest:
                yield b"\n".join(data.split(b"\n", rest)[:rest]) + b"\n"
                return
            yield data
            rest -= count if rest else 0

    def _chunks(self) -> Iterator[bytes]:
        """Yield the text in UTF-8, without empty lines at its end."""
        held = b""  # line ends, which are empty lines if nothing follows
        for data in self._raw():
            body = data.rstrip(b"\r\n")
            if not body:
                held += data
                continue
            data, held = held + body if held else body, data[len(body) :]
            yield _LONE_CR.sub(b"\n", data) if b"\r" in data else data
        if held:
            yield b"\n"

    def _raw(self) -> Iterator[bytes]:
        try:
            if self._text.encoding.lower() in _UTF8:
                with self._path.open("rb", buffering=0) as file:
                    head = file.read(BLOCK_BYTES)
                    data = head.removeprefix(b"\xef\xbb\xbf")
                    while data:
                        yield data
                        data = file.read(BLOCK_BYTES)
                return
            with self._path.open(encoding=self._text.encoding, newline="") as text:
                while part := text.read(BLOCK_BYTES // 2):
                    yield part.encode()
        except OSError as error:
            raise ConfigError(f"cannot read {self._path}: {error.strerror}") from error
        except LookupError as error:
            raise ConfigError(f"there is no encoding {self._text.encoding!r}",
                              hint="such as utf-8, latin-1 or utf-16") from error  # fmt: skip
        except UnicodeError as error:
            raise ConfigError(
                f"{self._path} is no text in {self._text.encoding}: {error}",
                hint="name its encoding below `text:`, such as `encoding: latin-1` or `utf-16`",
            ) from error

    def _head(self) -> list[str]:
        """Return the first lines, up to the first one of the data."""
        lines: list[bytes] = []
        carry = b""
        for data in self._chunks():
            *whole, carry = (carry + data).split(b"\n")
            lines += whole
            self._require_line(len(lines) + 1, carry)
            if len(lines) >= self._first_line:
                break
        if carry and len(lines) < self._first_line:
            lines.append(carry)
        head = []
        for number, raw in enumerate(lines[: self._first_line + 1], 1):
            try:
                head.append(raw.decode().rstrip("\r"))
            except UnicodeDecodeError as error:
                raise self._not_decoded(number, error.start + 1, raw[error.start]) from error
        return head

    def _not_decoded(self, line: int, column: int, byte: int) -> ConfigError:
        return ConfigError(
            f"byte 0x{byte:02x} is no text in {self._text.encoding}",
            place=self._at(line, column),
            hint="name the file's encoding below `text:`, such as `encoding: latin-1` or `utf-16`",
        )

    def _separator_of(self, names: str) -> str:
        given = self._text.separator
        if given is not None:
            return _SEPARATORS.get(given, given)
        return next((sign for sign in ("\t", ";", ",") if sign in names), ",")

    def _cells(self, line: str) -> list[str]:
        if self._text.separator == "space":
            return line.split()
        try:
            return next(csv.reader([line.rstrip("\r")], delimiter=self._separator), [""])
        except csv.Error as error:  # a cell of more than 128 KiB
            raise ConfigError(
                f"{self._path} has a line that is no row of a table: {error}"
            ) from error

    def _start_of(self, line: str, index: int) -> int:
        """Return the column, from 1, at which a cell of a line begins."""
        if self._text.separator == "space":
            starts = [match.start() for match in re.finditer(r"\S+", line)]
            return starts[index] + 1 if index < len(starts) else len(line) + 1
        position, quoted, cell = 0, False, 0
        for position, letter in enumerate(line):
            if cell == index:
                return position + 1
            if letter == '"':
                quoted = not quoted
            elif letter == self._separator and not quoted:
                cell += 1
        return position + 2 if cell == index else len(line) + 1

    @cached_property
    def _with_comment(self) -> re.Pattern[bytes]:
        """A line with a cell more than there are columns; its group is the line without it."""
        sign = re.escape(self._separator.encode())
        cell = rb"[^" + sign + rb"\r\n]*"
        others = rb"(?:" + cell + sign + rb"){%d}" % (len(self._names) - 1)
        return re.compile(rb"(?m)^(" + others + cell + rb")" + sign + rb".*$")

    @cached_property
    def _file(self) -> str:
        return str(self._path)

    def _at(self, line: int, column: int) -> Place:
        return Place(self._file, line, column)
