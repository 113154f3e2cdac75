"""Parses YAML 1.2 to plain data and keeps the position of every key and value.

Every scalar stays the text its author wrote: the schema, not YAML, decides whether ``1.50`` is a
number or ``no`` a word. Of YAML only what a rig file needs is accepted: one document of mappings,
lists and scalars. Anchors, aliases, tags and merge keys are refused, so that a file says what it
seems to say and cannot grow when it is read.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    DocumentStartEvent,
    Event,
    MappingEndEvent,
    MappingStartEvent,
    NodeEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
)
from ruamel.yaml.reader import ReaderError

from rigd.config.mistakes import explain
from rigd.model.errors import ConfigError, Place

#: Mappings, lists, text, and None for a key with nothing behind it.
Data: TypeAlias = "dict[str, Data] | list[Data] | str | None"
#: The keys and list indices that lead to a value.
Path_: TypeAlias = tuple[str | int, ...]

#: Bytes a rig or procedure file may have: a hundred times the longest we know.
MAX_BYTES: Final = 512 * 1024
#: How deep mappings and lists may nest; rig and procedure files need 6.
MAX_DEPTH: Final = 24
#: What libyaml, 15 times as fast, reads another way than the YAML 1.2 parser in Python: line breaks
#: no editor shows, tabs, directives, '? ' keys, a comment glued to a block scalar's header. A file
#: with any of it is left to the latter; on others the two agree, and a test says so.
_UNUSUAL: Final = re.compile(
    r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u2028\u2029\ufeff]|^%|(?<!\w)\?[\s:]|[|>][-+\d]*#", re.M
)


@dataclass(frozen=True)
class Document:
    """One YAML file: its data, and where each key and each value stands."""

    path: Path
    text: str
    data: Data
    values: dict[Path_, Place]
    keys: dict[Path_, Place]

    def place(self, path: Path_) -> Place:
        """Return where the value at ``path`` stands, or else the nearest one around it."""
        while path not in self.values and path:
            path = path[:-1]
        return self.values[path]

    def key_place(self, path: Path_) -> Place:
        """Return where the key at ``path`` stands, or else its value."""
        return self.keys.get(path) or self.place(path)

    def get(self, path: Path_) -> Data:
        """Return the value at ``path``, or None where there is none."""
        value: Any = self.data
        for step in path:
            try:
                value = value[step]
            except (KeyError, IndexError, TypeError):
                return None
        return value  # type: ignore[no-any-return]  # data is built from Data alone

    def inside(self, path: Path_, offset: int) -> Place:
        """Return the place ``offset`` characters into the text at ``path``, where it can be told.

        Text that spans lines or holds escapes gives the place where it begins.
        """
        place, value = self.place(path), self.get(path)
        lines = self.text.split("\n", place.line)
        if not isinstance(value, str) or len(lines) < place.line:
            return place
        rest = lines[place.line - 1][place.column - 1 :]
        quote = 1 if rest[:1] in ("'", '"') else 0
        if not rest[quote:].startswith(value):
            return place
        return Place(place.file, place.line, place.column + quote + offset)


def read_document(path: Path) -> Document:
    """Return the file at ``path`` as a document.

    Raises:
        ConfigError: the file cannot be read, is too large, is not UTF-8, or is not such YAML.

    """
    start = Place(str(path), 1, 1)
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise ConfigError(
            f"cannot read {path}: {error.strerror}", hint="check the path and the permissions"
        ) from error
    if len(raw) > MAX_BYTES:
        raise ConfigError(
            f"the file has more than {MAX_BYTES // 1024} KiB", place=start,
            hint="put long tables of numbers into smaller procedures",
        )  # fmt: skip
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        head = raw[: error.start]
        line_start = head.rfind(b"\n") + 1
        place = Place(
            str(path), head.count(b"\n") + 1, len(head[line_start:].decode(errors="replace")) + 1
        )
        raise ConfigError(
            f"byte 0x{raw[error.start]:02x} is not UTF-8 text", place=place,
            hint="save the file as UTF-8",
        ) from error  # fmt: skip
    return parse_document(text, path)


def parse_document(text: str, path: Path) -> Document:
    """Return ``text`` as a document; ``path`` is the name that errors give.

    Raises:
        ConfigError: the text is not such YAML.

    """
    if _UNUSUAL.search(text) is None:
        composer = _Composer(str(path))
        try:
            data = composer.compose(YAML(typ="safe", plug_ins=[]).parse(text))
        except (YAMLError, ConfigError, ValueError):
            pass  # the other parser says what is wrong, the same wherever rigd is installed
        else:
            return Document(path, text, data, composer.values, composer.keys)
    composer = _Composer(str(path))
    try:
        data = composer.compose(YAML(typ="safe", pure=True, plug_ins=[]).parse(text))
    except MarkedYAMLError as error:
        raise explain(error, text, composer.last) from error
    except ReaderError as error:
        raise ConfigError(
            f"character U+{ord(text[error.position]):04X} may not stand in YAML",
            place=_place_of(text, error.position, str(path)), hint="remove it",
        ) from error  # fmt: skip
    # The library lets slip what its own code meets in text it did not expect.
    except (YAMLError, ValueError, OverflowError, LookupError, AttributeError) as error:
        raise ConfigError(
            "the text from here on cannot be read as YAML 1.2", place=composer.last,
            hint="look for control characters and backslashes",
        ) from error  # fmt: skip
    return Document(path, text, data, composer.values, composer.keys)


def _place_of(text: str, position: int, file: str) -> Place:
    head = text[:position]
    return Place(file, head.count("\n") + 1, position - head.rfind("\n"))


class _Composer:
    """Builds data from the parser's events, and remembers where each came from."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.last = Place(file, 1, 1)
        self.values: dict[Path_, Place] = {}
        self.keys: dict[Path_, Place] = {}

    def compose(self, events: Iterator[Event]) -> Data:
        data: Data = None
        documents = 0
        for event in events:
            if isinstance(event, DocumentStartEvent):
                documents += 1
                self.last = self._place(event)
                if documents > 1:
                    raise ConfigError("a second document begins here", place=self.last,
                                      hint="one file, one document: split it at '---'")  # fmt: skip
                if event.version not in (None, (1, 2)):
                    raise ConfigError("the file asks for another YAML than 1.2", place=self.last,
                                      hint="remove the %YAML line")  # fmt: skip
            elif isinstance(event, NodeEvent):
                data = self._node(event, events, ())
        if not documents or data is None:
            raise ConfigError("the file is empty", place=self.last,
                              hint="begin with 'rig: NAME' or 'procedure: NAME'")  # fmt: skip
        return data

    def _node(self, event: Event, events: Iterator[Event], path: Path_) -> Data:
        place = self.last = self._place(event)
        self.values[path] = place
        self._refuse_extras(event, place)
        if isinstance(event, ScalarEvent):
            empty = event.value == "" and not event.style
            return None if empty or _is_null(event) else str(event.value)
        if len(path) >= MAX_DEPTH:
            raise ConfigError(f"nested deeper than {MAX_DEPTH} levels", place=place,
                              hint="check the brackets and the indentation")  # fmt: skip
        if isinstance(event, MappingStartEvent):
            return self._mapping(events, path)
        items: list[Data] = []
        for item in events:
            if isinstance(item, SequenceEndEvent):
                break
            items.append(self._node(item, events, (*path, len(items))))
        return items

    def _mapping(self, events: Iterator[Event], path: Path_) -> dict[str, Data]:
        mapping: dict[str, Data] = {}
        for event in events:
            if isinstance(event, MappingEndEvent):
                break
            place = self.last = self._place(event)
            self._refuse_extras(event, place)
            if not isinstance(event, ScalarEvent):
                raise ConfigError("a list or mapping cannot be a key", place=place,
                                  hint="quote text that holds braces: '${name}'")  # fmt: skip
            key = str(event.value)
            here = (*path, key)
            if key == "<<":
                raise ConfigError("merge keys are not YAML 1.2", place=place,
                                  hint="write the values out")  # fmt: skip
            if key in mapping:
                raise ConfigError(
                    f"key {key!r} stands twice; first in line {self.keys[here].line}",
                    place=place, hint="remove one of the two",
                )  # fmt: skip
            self.keys[here] = place
            value = mapping[key] = self._node(next(events), events, here)
            if value is None:  # the parser places nothing where the next thing begins
                self.values[here] = place
        return mapping

    def _refuse_extras(self, event: Event, place: Place) -> None:
        if isinstance(event, AliasEvent) or getattr(event, "anchor", None):
            raise ConfigError(
                "anchors and aliases (& and *) are not read", place=place,
                hint="write the value out, or make it a parameter; quote text that begins so",
            )  # fmt: skip
        if not isinstance(event, ScalarEvent | MappingStartEvent | SequenceStartEvent):
            raise ConfigError("a value was expected here", place=place)
        if event.tag is not None and str(event.tag) != "!":
            raise ConfigError("tags (!) are not read", place=place,
                              hint="quote text that begins with '!'")  # fmt: skip

    def _place(self, event: Event) -> Place:
        mark = event.start_mark
        return Place(self.file, mark.line + 1, mark.column + 1)


def _is_null(event: ScalarEvent) -> bool:
    return not event.style and event.value in ("~", "null", "Null", "NULL")
