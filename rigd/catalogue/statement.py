"""Makes of a condition a statement of SQL with parameters, for the index of a folder."""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping
from typing import Final, NamedTuple

from rigd.catalogue.facts import FIELDS
from rigd.catalogue.query import Condition, Operand, operand, wrong
from rigd.catalogue.values import DATE, NEAR
from rigd.language.syntax import ComparisonChain, Name, Node, Operation, State
from rigd.model.errors import ConfigError

#: A field without a dot that no folder has by itself is looked for as one of these.
_BARE: Final = ("parameter", "specimen", "meta", "run")
#: So many values of a field are named in an error.
_NAMED: Final = 8


class Statement(NamedTuple):
    """A condition of SQL on ``recordings.id``, and its parameters."""

    sql: str
    values: tuple[object, ...] = ()


def statement_of(condition: Condition, index: sqlite3.Connection) -> Statement:
    """Return the statement for a condition.

    Raises:
        ConfigError: no recording has such a field, or it has another unit.
    """
    return _Maker(index).of(condition)


class _Maker:
    """Makes statements for one index; it stores the name of a field as a number."""

    def __init__(self, index: sqlite3.Connection) -> None:
        self._index = index
        self._names: Mapping[str, int] = {
            name: number for number, name in index.execute("SELECT id, name FROM names")
        }

    def of(self, condition: Node) -> Statement:
        """Return the statement for a condition, with those of its parts."""
        match condition:
            case Operation(sign="not", operands=(inner,)):
                sql, values = self.of(inner)
                return Statement(f"NOT ({sql})", values)
            case Operation(sign=word, operands=parts):
                made = [self.of(part) for part in parts]
                sql = f" {word.upper()} ".join(f"({item.sql})" for item in made)
                return Statement(sql, tuple(value for item in made for value in item.values))
            case State(subject=Name() as field, word=word, is_so=is_so):
                known = self._having(self.number(field), "1", ())
                if (word.name == "known") == is_so:
                    return known
                return Statement(f"NOT ({known.sql})", known.values)
            case ComparisonChain(signs=(sign, *_), operands=(Name() as field, *values)):
                return self._comparison(field, sign, [operand(value) for value in values])
        raise TypeError(f"{condition} is no condition")

    def _comparison(self, field: Name, sign: str, values: list[Operand]) -> Statement:
        """Return the statement for recordings whose field compares by ``sign`` with a value."""
        field_number = self.number(field)
        if sign != "!=":
            return self._any(field_number, field, "==" if sign == "in" else sign, values)
        same = self._any(field_number, field, "==", values)
        known = self._having(field_number, "1", ())
        return Statement(f"{known.sql} AND NOT ({same.sql})", known.values + same.values)

    def _any(self, field_number: int, field: Name, sign: str, values: list[Operand]) -> Statement:
        made = [self._test(field_number, field, sign, value) for value in values]
        sql = " OR ".join(f"({item.sql})" for item in made)
        return self._having(field_number, sql, tuple(v for item in made for v in item.values))

    def _test(self, field_number: int, field: Name, sign: str, literal: Operand) -> Statement:
        """Return the test of one fact against ``literal``; ``sign`` is such as ``==`` or ``<``.

        Numbers count as equal if they differ by at most the share NEAR.
        """
        text, value, unit = literal.value
        if sign == "contains":
            return Statement("instr(casefold(text), casefold(?)) > 0", (text,))
        if not literal.quoted or sign != "==":
            self._check_unit(field_number, field.name, sign, literal)
        if literal.period is not None:
            dated = _dated(sign, *literal.period)
            if sign == "==":
                return Statement(f"text = ? OR ({dated.sql})", (text, *dated.values))
            return dated
        if value is None:
            return Statement("text = ?", (text,))
        if sign == "==":
            tolerance = abs(value) * NEAR
            return Statement(
                "text = ? OR (unit = ? AND number BETWEEN ? AND ?)",
                (text, unit, value - tolerance, value + tolerance),
            )
        return Statement(f"unit = ? AND number {sign} ?", (unit, value))

    def _check_unit(self, field_number: int, field: str, sign: str, literal: Operand) -> None:
        """Raise if the field has no value that can be compared with this one."""
        rows = self._index.execute(
            "SELECT DISTINCT coalesce(unit, '') FROM facts WHERE name = ?", (field_number,)
        )
        units = sorted(unit for (unit,) in rows)
        text, value, unit = literal.value
        offset = literal.offset
        if value is None:
            if sign != "==":
                raise wrong(
                    offset,
                    f"{field} {sign} {text!r}: a word is neither less nor more",
                    "compare it with ==, != or contains; give a number with its unit, or a date",
                )
            return
        if not units or unit in units:
            return
        if units == [""]:
            raise wrong(
                offset, f"{field} is a text, and {text} is not",
                f"write it in quotes: {field} == \"{text}\"",
            )  # fmt: skip
        stated = " or ".join("a date" if u == DATE else "a plain number" if u == "1" else f"in {u}"
                             for u in units if u)  # fmt: skip
        hint = f"write {text} {units[-1]}" if unit == "1" and units[-1] != DATE else None
        if unit != "1" and DATE not in units:
            hint = f"give it in {units[-1]}"
        if DATE in units:
            hint = "write a date such as 2026-09-01"
        raise wrong(offset, f"{field} is {stated}, and {text} is not", hint)

    def _having(self, field_number: int, sql: str, values: tuple[object, ...]) -> Statement:
        """Return the statement for recordings with a fact of the field that passes ``sql``."""
        return Statement(
            f"id IN (SELECT recording FROM facts WHERE name = ? AND ({sql}))",
            (field_number, *values),
        )

    def number(self, asked: Name) -> int:
        """Return the number of a field; 0, which no fact has, if no recording here states it.

        Raises:
            ConfigError: it is misspelt, or stands for several fields.
        """
        field = asked.name
        if field in FIELDS or field in self._names:
            return self._names.get(field, 0)
        found = [f"{group}.{field}" for group in _BARE if f"{group}.{field}" in self._names]
        if len(found) > 1:
            message = f"{field!r} can be {' or '.join(found)}"
            raise wrong(asked.start, message, "write one of them")
        if found:
            return self._names[found[0]]
        if asked.start < 0 or not self._names:
            return 0
        raise self._unknown(field, asked.start)

    def _unknown(self, field: str, offset: int) -> ConfigError:
        """Return the error for a field that no recording has, with a name close to it."""
        from rigd.config.problems import suggest

        short = {name.partition(".")[2]: name for name in self._names if "." in name}
        known = {*FIELDS, *self._names}
        hint = suggest(field, known)
        near = suggest(field, short)
        if not hint.startswith("did you mean") and near.startswith("did you mean"):
            hint = near
        return wrong(offset, f"no recording here has a field {field!r}", hint)


def _dated(sign: str, start: float, end: float) -> Statement:
    """Return the test of a date: ``==`` is within the period that was written, ``>`` after it."""
    tests: Mapping[str, tuple[str, tuple[float, ...]]] = {
        "==": ("number >= ? AND number < ?", (start, end)),
        "<": ("number < ?", (start,)),
        "<=": ("number < ?", (end,)),
        ">": ("number >= ?", (end,)),
        ">=": ("number >= ?", (start,)),
    }
    sql, values = tests[sign]
    return Statement(f"unit = '{DATE}' AND {sql}", values)


def stated(index: sqlite3.Connection, field: Name) -> list[str]:
    """Return the values of a field, each with how many recordings have it, most frequent first."""
    maker = _Maker(index)
    found = index.execute(
        "SELECT text, count(DISTINCT recording) AS many FROM facts WHERE name = ? GROUP BY text "
        f"ORDER BY many DESC, text LIMIT {_NAMED + 1}",
        (maker.number(field),),
    ).fetchall()
    texts = [f"{text} ({many})" for text, many in found]
    return [*texts[:_NAMED], "…"] if len(texts) > _NAMED else texts
