"""Reads what a lab demands of every run (``lab.yaml``), and the files of its specimens.

The rig file names the file of its lab (``lab: lab.yaml``), so that the demands hold wherever a run
is started from. A specimen is found by its name: ``W7`` is ``specimens/W7.yaml``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import Field, StringConstraints

from rigd.config.binding import bind
from rigd.config.document import Document, KeyPath, read_document
from rigd.config.lab.publication import PublicationSource, check_publication
from rigd.config.problems import Problems
from rigd.config.source import FileName, FilePath, QuantityText, Source
from rigd.model.about import About, check_text
from rigd.model.errors import ConfigError, Place
from rigd.model.limits import rounded_to
from rigd.model.units import parse_quantity, parse_unit

#: Where specimens stand if no lab states another folder.
SPECIMENS: Final = Path("specimens")
#: The name under which a recording carries the file of its specimen.
SPECIMEN_FILE: Final = "specimen.yaml"
_MOST_LETTERS: Final = 200
_MOST_ENTRIES: Final = 64
_KEY: Final = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,39}")

#: A field as searches call it.
FieldName = Annotated[
    str,
    StringConstraints(
        pattern=r"^(operator|note|specimen"
        r"|meta\.[A-Za-z][A-Za-z0-9_-]*|specimen\.[A-Za-z][A-Za-z0-9_.-]*)$"
    ),
]
Words = Annotated[str, StringConstraints(min_length=1, max_length=_MOST_LETTERS)]


class FieldSource(Source):
    """What a field must be."""

    doc: Words = ""
    """Its meaning, for the operator."""
    required: bool = False
    """Whether a run without it is refused; of `specimen.NAME`: a run with a specimen."""
    kind: Literal["text", "number", "date"] = "text"
    """The kind of its value; a `unit` makes it a quantity."""
    unit: Annotated[str, StringConstraints(min_length=1, max_length=40)] | None = None
    """A unit of its kind; any other unit of that kind may be given."""
    min: QuantityText | None = None
    """The least value."""
    max: QuantityText | None = None
    """The largest value."""
    choices: Annotated[tuple[Words, ...], Field(max_length=100)] = ()
    """The only values that are allowed."""


class LabSource(Source):
    """What a lab demands of every run."""

    lab: FileName
    """Name of the lab."""
    specimens: FilePath = str(SPECIMENS)
    """Folder of the files of specimens; relative to this file."""
    fields: Annotated[dict[FieldName, FieldSource], Field(max_length=100)]
    """Fields by name: `operator`, `note`, `specimen`, `meta.NAME`, `specimen.NAME`."""
    publication: PublicationSource | None = None
    """What holds for data that the lab publishes: licence, authors, publisher."""


@dataclass(frozen=True)
class Specimen:
    """A specimen by name; ``fields`` and ``text`` are from its file, empty if it has none."""

    name: str = ""
    fields: Mapping[str, str] = field(default_factory=dict)
    text: str = ""
    path: Path | None = None


@dataclass(frozen=True)
class Lab:
    """The demands of a lab, and the folder of its specimens."""

    name: str
    specimens: Path
    fields: Mapping[str, FieldSource]
    places: Mapping[str, Place]
    publication: PublicationSource = field(default_factory=PublicationSource)


def load_lab(path: Path) -> Lab:
    """Return the lab in a file.

    Raises:
        ConfigError: it is missing or wrong; names every problem with its place.
    """
    document = read_document(path)
    problems = Problems()
    source = bind(document, LabSource, problems)
    for name, item in ({} if source is None else source.fields).items():
        _check_field(document, name, item, problems)
    if source is not None and source.publication is not None:
        check_publication(document, source.publication, problems)
    problems.raise_any()
    if source is None:
        raise ConfigError("the lab file cannot be used", place=document.place(()))
    return Lab(
        source.lab,
        path.parent / source.specimens,
        source.fields,
        {name: document.key_place(("fields", name)) for name in source.fields},
        source.publication or PublicationSource(),
    )


def load_specimen(name: str, folder: Path) -> Specimen:
    """Return the specimen of that name, without fields if the folder has no file of it.

    Raises:
        ConfigError: its file is wrong; names every problem with its place.
    """
    path = folder / f"{name}.yaml"
    if not path.exists():
        return Specimen(name)
    return read_specimen(read_document(path), name)


def read_specimen(document: Document, name: str | None = None) -> Specimen:
    """Return the specimen that a file describes; ``name`` is that of the file, if it matters.

    Raises:
        ConfigError: it is wrong; names every problem with its place.
    """
    problems = Problems()
    fields = dict(_entries(document, (), problems))
    stated = fields.pop("specimen", "")
    if not stated:
        problems.add(
            document.place(()), "the name of the specimen is missing", "begin with 'specimen: W7'"
        )
    elif name is not None and stated != name:
        problems.add(
            document.place(("specimen",)),
            f"this is specimen {stated!r}, and its file is called {name}.yaml",
            "give the file the name of the specimen",
        )
    try:
        About(specimen=stated)
    except ValueError as error:
        problems.add(document.place(("specimen",)), str(error))
    if len(fields) > _MOST_ENTRIES:
        problems.add(
            document.place(()), f"{len(fields)} entries, at most {_MOST_ENTRIES} are allowed"
        )
    if "name" in fields:
        problems.add(document.key_place(("name",)), "'name' is that of the specimen", "rename it")
    problems.raise_any()
    return Specimen(stated, fields, document.text, document.path)


def _entries(document: Document, path: KeyPath, problems: Problems) -> Iterator[tuple[str, str]]:
    """Yield every entry with its value as written; those below another with a dot between."""
    data = document.get(path)
    if not isinstance(data, dict):
        problems.add(document.place(path), "expected names with values", "such as coating: PTFE")
        return
    for key, value in data.items():
        where = (*path, key)
        if _KEY.fullmatch(key) is None:
            problems.add(
                document.key_place(where), f"{key!r} is not a name",
                "begin with a letter; letters, digits, _ and - follow, 40 in all",
            )  # fmt: skip
        elif isinstance(value, dict):
            inner = _entries(document, where, problems)
            yield from ((f"{key}.{name}", text) for name, text in inner)
        elif isinstance(value, str) and value.strip():
            try:
                check_text(value, key, _MOST_LETTERS)
            except ValueError as error:
                problems.add(document.place(where), str(error))
            yield key, value
        else:
            found = "a list" if isinstance(value, list) else "empty"
            problems.add(
                document.place(where),
                f"{key} is {found}",
                "write a text, or a number with its unit",
            )


def stated_specimen(about: About, lab_file: Path | None) -> Specimen:
    """Return the specimen of a run, after a check of all that is stated against the lab.

    Without a lab, files of specimens stand below the current folder.

    Raises:
        ConfigError: a demand of the lab is not met, or a file is wrong; names every problem.
    """
    lab = None if lab_file is None else load_lab(lab_file)
    specimen = Specimen()
    if about.specimen:
        specimen = load_specimen(about.specimen, SPECIMENS if lab is None else lab.specimens)
    if lab is not None:
        _check(lab, about, specimen)
    return specimen


def _check(lab: Lab, about: About, specimen: Specimen) -> None:
    given = {
        "operator": about.operator, "note": about.note, "specimen": about.specimen,
        **{f"meta.{name}": text for name, text in about.meta.items()},
        **{f"specimen.{name}": text for name, text in specimen.fields.items()},
    }  # fmt: skip
    problems = []
    for name, demand in lab.fields.items():
        text = given.get(name, "")
        if not text:
            of_specimen = name.startswith("specimen.")
            if demand.required and (about.specimen or not of_specimen):
                problems.append(_missing(lab, name, demand, specimen))
            continue
        wrong = _mistake(demand, text)
        if wrong:
            where = "" if specimen.path is None else f" in {specimen.path}"
            shown = f"{name}{where if name.startswith('specimen.') else ''}"
            problems.append(
                ConfigError(
                    f"{shown}: {text!r} {wrong}", place=lab.places[name], hint=demand.doc or None
                )
            )
    if problems:
        raise ConfigError.several(problems)


def _missing(lab: Lab, name: str, demand: FieldSource, specimen: Specimen) -> ConfigError:
    group, _, key = name.partition(".")
    example = (
        demand.choices[0] if demand.choices else f"... {demand.unit}" if demand.unit else "..."
    )
    if not key:
        todo = f"give --{name} {'NAME' if name != 'note' else 'TEXT'}"
    elif group == "meta":
        todo = f"give --meta {key}={example!r}".replace("'", '"')
    else:
        file = specimen.path or lab.specimens / f"{specimen.name}.yaml"
        todo = f"write '{key}: {example}' into {file}"
    about = f": {demand.doc}" if demand.doc else ""
    return ConfigError(
        f"the lab {lab.name} demands {name} of each run, and it is missing{about}",
        place=lab.places[name], hint=todo,
    )  # fmt: skip


def _mistake(demand: FieldSource, text: str) -> str:
    """Return why a text is not what the lab demands; "" if it is."""
    if demand.choices and text not in demand.choices:
        return f"is not one of {', '.join(demand.choices)}"
    if demand.kind == "date":
        try:
            date.fromisoformat(text)
        except ValueError:
            return "is not a date such as 2026-09-01"
        return ""
    if demand.kind == "text" and demand.unit is None:
        return ""
    unit = parse_unit(demand.unit or "1")
    try:
        quantity = parse_quantity(text)
    except ValueError as error:
        return f"is not a {'number' if demand.unit is None else 'quantity'}: {error}"
    if not quantity.unit.same_kind(unit):
        return f"is not in {unit}" if demand.unit else "is not a number without a unit"
    low = -math.inf if demand.min is None else parse_quantity(demand.min).value
    high = math.inf if demand.max is None else parse_quantity(demand.max).value
    value = rounded_to(low, quantity.value, high)
    if value < low:
        return f"is less than {demand.min}"
    if value > high:
        return f"is more than {demand.max}"
    return ""


def _check_field(document: Document, name: str, item: FieldSource, problems: Problems) -> None:
    path: KeyPath = ("fields", name)
    if item.unit is not None and item.kind != "text":
        problems.add(
            document.key_place((*path, "unit")), f"a {item.kind} has no unit", "remove one"
        )
        return
    is_number = item.unit is not None or item.kind == "number"
    try:
        unit = parse_unit(item.unit or "1")
    except ValueError as error:
        problems.add(document.place((*path, "unit")), str(error))
        return
    for key, bound in (("min", item.min), ("max", item.max)):
        if bound is None:
            continue
        place = document.place((*path, key))
        if not is_number:
            problems.add(place, f"{key} bounds a quantity", "give its unit, or kind: number")
            continue
        try:
            kind = parse_quantity(bound).unit
        except ValueError as error:
            problems.add(place, str(error))
            continue
        if not kind.same_kind(unit):
            problems.add(place, f"{key} is {bound}, and the unit is {unit}", "write the same kind")
