"""Reads JSON lines: an object in each line, its nested keys joined by dots, `imu.acc.x`.

pyarrow parses each block of whole lines. If it refuses one, this block is read again line by line,
to find the first line that is wrong.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.json as pa_json

from rigd.importing.tables.bounds import require_columns
from rigd.importing.tables.table import Batch, Kind
from rigd.model.errors import ConfigError, Place

#: Text that is parsed at once, in bytes.
BLOCK_BYTES: Final = 8 << 20
#: A line has no more, in bytes.
_MOST_BYTES: Final = 16 << 20
#: Lines whose keys are the columns.
NAMED_LINES: Final = 2000
#: Objects in each other; the recursion of a parser ends later.
_MOST_DEPTH: Final = 32
_BOM: Final = b"\xef\xbb\xbf"
Keys = tuple[str, ...]


class JsonTable:
    """One file of JSON lines; see :class:`rigd.importing.tables.table.SourceTable`.

    Its columns are the keys of the first 2,000 lines. A key that a line lacks, null and NaN
    are no value. Lists are no columns.
    """

    def __init__(self, path: Path) -> None:
        """Read the first lines.

        Raises:
            ConfigError: the file cannot be read, a line is no object, or none has a value.
        """
        self._path = path
        found: dict[Keys, set[type]] = {}
        _, block = next(self._blocks())
        for number, line in enumerate(block.splitlines()[:NAMED_LINES], 1):
            _gather(self._object(number, line), (), found)
        self._keys = list(found)
        self._types = [found[keys] - {type(None)} for keys in self._keys]
        require_columns(path, "line 1", len(self._keys))
        if not self._keys:
            raise ConfigError("the objects have no values", place=Place(str(path), 1, 1))

    @property
    def path(self) -> Path:
        """The file."""
        return self._path

    @property
    def names(self) -> list[str]:
        """The keys, with those of the objects around them."""
        return [".".join(keys) for keys in self._keys]

    @property
    def start_ns(self) -> int | None:
        """None: the format has no place for it."""
        return None

    def unit(self, column: int) -> str:
        """Return "": the format has no place for it."""
        return ""

    def is_whole(self, column: int) -> bool:
        """Return whether the first lines have whole numbers."""
        return self._types[column] == {int}

    def place(self, column: int, row: int | None = None) -> Place:
        """Return the line of a row; the place in it is the number of the column."""
        return Place(str(self._path), 1 if row is None else row + 1, column + 1)

    def batches(self, wanted: Mapping[int, Kind]) -> Iterator[Batch]:
        """Yield all rows of the ``wanted`` columns, in order.

        Raises:
            ConfigError: a line is no object, or a value is of another type.
        """
        types = {column: self._type(column, kind) for column, kind in wanted.items()}
        schema = _schema({self._keys[column]: item for column, item in types.items()})
        for row, block in self._blocks():
            table = self._parsed(row, block, schema, wanted)
            numbers: dict[int, Any] = {}
            texts: dict[int, Any] = {}
            for column, kind in wanted.items():
                first, *rest = self._keys[column]
                values = table.column(first)
                values = pc.struct_field(values, rest) if rest else values
                if kind == "text":
                    texts[column] = values.cast(pa.string()).fill_null("").combine_chunks()
                    continue
                if kind == "whole" and values.null_count:
                    at = values.is_null().index(True).as_py()
                    raise ConfigError("a time is missing", place=self.place(column, row + at))
                numbers[column] = found = values.cast(_NUMBERS[kind]).to_numpy()
                if np.any(np.isinf(found)):
                    at = int(np.flatnonzero(np.isinf(found))[0])
                    raise ConfigError(
                        f"the value of {self.names[column]!r} is Infinity, or too large",
                        place=self.place(column, row + at),
                    )
            yield Batch(row, table.num_rows, numbers, texts)

    def _type(self, column: int, kind: Kind) -> Any:
        """Return as what pyarrow shall read a column."""
        types = self._types[column]
        if types == {bool}:
            return pa.bool_()
        if kind == "text":
            return (
                pa.string() if str in types else _NUMBERS["whole" if types == {int} else "number"]
            )
        return _NUMBERS[kind]

    def _parsed(self, row: int, block: bytes, schema: Any, wanted: Mapping[int, Kind]) -> Any:
        try:
            table = pa_json.read_json(
                pa.BufferReader(block),
                pa_json.ReadOptions(use_threads=False, block_size=len(block) + 1),
                pa_json.ParseOptions(explicit_schema=schema, unexpected_field_behavior="ignore"),
            )
            if table.num_rows == block.count(b"\n"):
                return table
            reason = "a line has no object, or several"
        except pa.ArrowException as error:
            reason = str(error)
        lines = block.split(b"\n")[:-1]
        for number, line in enumerate(lines, row + 1):
            self._check(number, self._object(number, line), wanted)
        raise ConfigError(
            f"lines {row + 1} to {row + len(lines)} cannot be read: {reason}",
            place=Place(str(self._path), row + 1, 1),
        )

    def _object(self, number: int, line: bytes) -> dict[str, Any]:
        """Return the object of a line.

        Raises:
            ConfigError: there is none.
        """
        place = Place(str(self._path), number, 1)
        try:
            found = json.loads(line, parse_constant=_constant)
        except (ValueError, RecursionError) as error:
            why = "it has objects or lists too deep in each other"
            if isinstance(error, json.JSONDecodeError):
                place = Place(str(self._path), number, error.colno)
                why = error.msg
            elif isinstance(error, UnicodeDecodeError):
                why = "its text is not UTF-8"
            elif isinstance(error, ValueError):
                why = str(error)
            raise ConfigError(f"the line is no JSON, or is cut off: {why}", place=place) from error
        if not isinstance(found, dict):
            raise ConfigError('the line has no object such as {"t": 0.1}', place=place)
        return found

    def _check(self, number: int, found: dict[str, Any], wanted: Mapping[int, Kind]) -> None:
        """Raise if a value of a line is not of the type that its column has."""
        for column, kind in wanted.items():
            value: Any = found
            for key in self._keys[column]:
                value = value.get(key) if isinstance(value, dict) else value
            right: tuple[type, ...] = {"number": (int, float), "whole": (int,), "text": (str,)}[
                kind
            ]
            if kind == "text" and str not in self._types[column]:
                right = (int, float)
            if self._types[column] == {bool}:
                right = (bool,)
            if value is not None and type(value) not in right:
                what = json.dumps(value)[:60]
                expected = "a text" if right == (str,) else "a number"
                expected = "true or false" if right == (bool,) else expected
                raise ConfigError(
                    f"the value of {self.names[column]!r} is {what}, expected {expected}",
                    place=self.place(column, number - 1),
                )

    def _blocks(self) -> Iterator[tuple[int, bytes]]:
        """Yield blocks of whole lines, each with the number of its first row, from 0."""
        row, carry = 0, b""
        try:
            with self._path.open("rb", buffering=0) as file:
                data = file.read(BLOCK_BYTES).removeprefix(_BOM)
                while data:
                    data = carry + data
                    end = data.rfind(b"\n") + 1
                    block, carry = data[:end], data[end:]
                    if len(carry) > _MOST_BYTES:
                        raise ConfigError(
                            f"the line has more than {_MOST_BYTES} bytes",
                            place=Place(str(self._path), row + block.count(b"\n") + 1, 1),
                        )
                    data = file.read(BLOCK_BYTES)
                    if not data:  # the last line may lack its end, and empty ones may follow
                        block, carry = (block + carry).rstrip() + b"\n", b""
                    if block:
                        yield row, block
                        row += block.count(b"\n")
        except OSError as error:
            raise ConfigError(f"cannot read {self._path}: {error.strerror}") from error


_NUMBERS: Final[dict[str, Any]] = {"number": pa.float64(), "whole": pa.int64()}


def _constant(name: str) -> float:
    """Return NaN, which others write for no value; it is no JSON, and Infinity is no number."""
    if name != "NaN":
        raise ValueError(f"{name} is no number")
    return math.nan


def _gather(found: dict[str, Any], around: Keys, into: dict[Keys, set[type]]) -> None:
    """Note the types of all values of an object but lists, by their keys."""
    for key, value in found.items():
        keys = (*around, key)
        if isinstance(value, dict):
            if len(keys) < _MOST_DEPTH:
                _gather(value, keys, into)
        elif not isinstance(value, list):
            into.setdefault(keys, set()).add(type(value))


def _schema(types: Mapping[Keys, Any]) -> Any:
    """Return the schema of nested objects that has these columns alone."""
    return pa.schema(_fields(types))


def _fields(types: Mapping[Keys, Any]) -> Sequence[tuple[str, Any]]:
    inner: dict[str, dict[Keys, Any]] = {}
    for (first, *rest), item in types.items():
        inner.setdefault(first, {})[tuple(rest)] = item
    return [
        (name, part[()] if () in part else pa.struct(_fields(part))) for name, part in inner.items()
    ]
