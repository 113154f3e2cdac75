"""What a row of a table in the documents names is there: keys, options, commands, units, codes."""

from __future__ import annotations

import argparse
import importlib
import pkgutil
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest
from pydantic import BaseModel

import rigd
import rigd_analyses
import rigd_drivers
import rigd_sim
from rigd.cli.main import build_parser
from rigd.config.registry import DRIVERS, find
from rigd.model.errors import ConfigError, Exit
from rigd.model.units import parse_quantity, parse_unit
from rigd.sdk import AnyDriver

ROOT = Path(__file__).parents[2]
CODE = re.compile(r"`([^`]+)`")
NAME = re.compile(r"[a-z][a-z0-9]*(?:_[a-z0-9]+)*")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")
#: A number and a unit, as a file has them: 2.5 m/s, 100 ms, 0.1 %.
QUANTITY = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)? (?!s to )[A-Za-zµ%°][\w^*/µ%° -]*")
UNIT = re.compile(r"(?!.*(?:\b(?:of|by)\b|_))[\w/^*µ%° ]+")
#: What devices answer, in units of their own.
FOREIGN = ("-18.78 lbF",)


@dataclass(frozen=True)
class Table:
    """A table: its document, the line of its heading, the cells of heading and rows."""

    document: str
    line: int
    heading: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def __str__(self) -> str:
        return f"{self.document}:{self.line}"

    def column(self, *names: str) -> list[str]:
        """Return the cells of the columns of these headings."""
        at = [place for place, name in enumerate(self.heading) if name in names]
        return [row[place] for row in self.rows for place in at if place < len(row)]


def tables_of(path: Path) -> Iterator[Table]:
    lines = path.read_text("utf-8").splitlines()
    at = 0
    while at < len(lines):
        if lines[at].startswith("|") and re.fullmatch(
            r"\|[-| :]+\|", (lines[at + 1 : at + 2] or [""])[0]
        ):
            end = at + 2
            while end < len(lines) and lines[end].startswith("|"):
                end += 1
            heading, *rows = (cells(line) for line in (lines[at], *lines[at + 2 : end]))
            yield Table(path.name, at + 1, heading, tuple(rows))
            at = end
        at += 1


def cells(line: str) -> tuple[str, ...]:
    """Return the cells of a row; a bar behind a backslash is text."""
    parts = re.split(r"(?<!\\)\|", line.strip().strip("|"))
    return tuple(part.strip().replace("\\|", "|") for part in parts)


TABLES = [
    table
    for path in (*sorted((ROOT / "docs").glob("*.md")), ROOT / "README.md")
    for table in tables_of(path)
]


@cache
def models() -> tuple[type[BaseModel], ...]:
    """Return all models of all packages."""
    for package in (rigd, rigd_drivers, rigd_sim, rigd_analyses):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)
    found, waiting = [], [BaseModel]
    while waiting:
        model = waiting.pop()
        found.append(model)
        waiting += model.__subclasses__()
    return tuple(found)


def keys_of(model: type[BaseModel]) -> set[str]:
    return {
        name for key, field in model.model_fields.items() for name in (key, field.alias) if name
    }


@cache
def commands() -> dict[str, set[str]]:
    """Return the options of each command, and of each command below it: `remote list`."""
    found: dict[str, set[str]] = {}

    def take(parser: argparse.ArgumentParser, name: str) -> None:
        found[name] = {text for action in parser._actions for text in action.option_strings}
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                for below, other in action.choices.items():
                    take(other, f"{name} {below}".strip())

    take(build_parser(), "")
    return found


@cache
def sources() -> str:
    """Return the code of all packages, in which the keys of JSON objects are texts."""
    packages = ("rigd", "drivers", "sim_backend", "analyses")
    return "\n".join(
        path.read_text("utf-8") for name in packages for path in (ROOT / name).rglob("*.py")
    )


def names_of(table: Table) -> set[str]:
    names = {name for name in in_code([row[0] for row in table.rows]) if NAME.fullmatch(name)}
    # By these two the model of an observer is chosen, and given its values.
    return names - ({"model", "constants"} if table.document == "observers.md" else set())


def model_of(table: Table) -> type[BaseModel]:
    """Return the model that has most keys of a table itself, and the others in its parts."""
    names = names_of(table)
    return min(
        models(),
        key=lambda model: (len(names - with_parts(model)), len(names - keys_of(model))),
    )


def with_parts(model: type[BaseModel]) -> set[str]:
    """Return the keys of a model, and of the models that its keys have."""
    found = keys_of(model)
    waiting = [field.annotation for field in model.model_fields.values()]
    while waiting:
        kind = waiting.pop()
        waiting += getattr(kind, "__args__", ())
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            found |= keys_of(kind)
    return found


def in_code(texts: list[str]) -> list[str]:
    return [code for text in texts for code in CODE.findall(text)]


def marked(tables: list[Table]) -> list[object]:
    return [pytest.param(table, id=str(table)) for table in tables]


#: Headings of the first column of tables that list keys of a file, or of a JSON object.
KEYS = ("key", "option", "section", "entry")


@pytest.mark.parametrize("table", marked([each for each in TABLES if each.heading[0] in KEYS]))
def test_keys_of_a_table_are_there(table: Table) -> None:
    """One model has all keys of a table; those of a JSON object are texts in the code."""
    names = names_of(table)
    if table.heading[1:2] in (("what it holds",), ("kind",)):
        assert not {name for name in names if not re.search(rf'"{name}"|\b{name}: ', sources())}
    else:
        assert not names - with_parts(model_of(table))


@pytest.mark.parametrize(
    "table", marked([each for each in TABLES if each.heading[-1] == "if left out"])
)
def test_defaults_of_a_table_are_those(table: Table) -> None:
    """A key that must be there is `required`; a value that is stated is that of the model."""
    fields = {field.alias or key: field for key, field in model_of(table).model_fields.items()}
    for row in table.rows:
        names = [name for name in in_code([row[0]]) if name in fields]
        if len(names) == 1 and len(row) == len(table.heading):
            field, stated = fields[names[0]], row[-1].strip("`")
            if field.is_required():
                assert stated.startswith("required"), names[0]
            elif (value := value_of(stated)) is not None and field.default is not None:
                assert stated == field.default or field.default == value, names[0]


def value_of(text: str) -> object:
    """Return the value of a key as text has it; None: the text says it in words."""
    if text in ("true", "false"):
        return text == "true"
    if re.fullmatch(r"[\d.]+", text):
        return float(text)
    if QUANTITY.fullmatch(text):
        return pytest.approx(parse_quantity(text).value)
    return text if text in WORDS else None


#: Choices that stand in a column `if left out`.
WORDS = (
    "moving", "run", "continuous", "all", "stop", "medium", "stone", "clean", "paper", "equal",
)  # fmt: skip


@pytest.mark.parametrize("table", marked([each for each in TABLES if "driver" in each.heading]))
def test_drivers_of_a_table_and_options_exist(table: Table) -> None:
    places = [table.heading.index(name) for name in ("driver", "options") if name in table.heading]
    for row in table.rows:
        for name in in_code([row[places[0]]]):
            config = find(DRIVERS, AnyDriver, "driver", name).Config
            options = in_code([row[place] for place in places[1:]])
            names = {option.partition(":")[0] for option in options}
            choices = str([field.annotation for field in config.model_fields.values()])
            names = {each for each in names if NAME.fullmatch(each) and f"'{each}'" not in choices}
            assert names <= keys_of(config), name


@pytest.mark.parametrize("table", marked(TABLES))
def test_keys_with_a_value_exist(table: Table) -> None:
    known = set().union(*map(keys_of, models()))
    for code in in_code([cell for row in table.rows for cell in row]):
        if (entry := re.fullmatch(r"([a-z_]+): .+", code)) is not None:
            assert entry[1] in known, code


@pytest.mark.parametrize("table", marked(TABLES))
def test_commands_and_options_of_a_table_exist(table: Table) -> None:
    every = set().union(*commands().values())
    for code in in_code([cell for row in (table.heading, *table.rows) for cell in row]):
        words = re.findall(r"(?<!\S)rigd ((?:[a-z-]+)(?: [a-z-]+)?)", code)
        known = every
        for word in words:
            name = word if word in commands() else word.split()[0]
            assert name in commands(), code
            known = commands()[name] | commands()[""]
        assert not set(OPTION.findall(code)) - known, code


@pytest.mark.parametrize("table", marked(TABLES))
def test_quantities_and_units_of_a_table_are_read(table: Table) -> None:
    for code in in_code([cell for row in table.rows for cell in row]):
        if QUANTITY.fullmatch(code) and code not in FOREIGN:
            parse_quantity(code)
    for cell in table.column("unit"):
        for unit in in_code([cell]) or [cell]:
            if UNIT.fullmatch(unit):
                parse_unit(unit)


@pytest.mark.parametrize("table", marked([each for each in TABLES if "exit code" in each.heading]))
def test_exit_codes_of_a_table_exist(table: Table) -> None:
    for cell in table.column("exit code"):
        for number in re.findall(r"\d+", cell):
            assert int(number) in set(Exit)


def test_tables_are_found() -> None:
    assert len(TABLES) > 150
    assert sum(len(table.rows) for table in TABLES) > 1500


@pytest.mark.parametrize(
    ("text", "check"),
    [
        ("| key | x |\n|---|---|\n| `low`, `hihg` | |\n", test_keys_of_a_table_are_there),
        ("| a |\n|---|\n| `rigd infos FILE` |\n", test_commands_and_options_of_a_table_exist),
        ("| a |\n|---|\n| `rigd info --jsn` |\n", test_commands_and_options_of_a_table_exist),
        ("| a |\n|---|\n| `5 ms/bar2x` |\n", test_quantities_and_units_of_a_table_are_read),
        ("| a | exit code |\n|---|---|\n| x | 12 |\n", test_exit_codes_of_a_table_exist),
        ("| driver |\n|---|\n| `ni-dak` |\n", test_drivers_of_a_table_and_options_exist),
        ("| a |\n|---|\n| `wachdog: 5 ms` |\n", test_keys_with_a_value_exist),
    ],
)
def test_wrong_row_is_found(text: str, check: Callable[[Table], None], tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(text)
    (table,) = tables_of(page)
    with pytest.raises((AssertionError, ValueError, ConfigError)):
        check(table)
