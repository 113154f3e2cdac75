"""Parses YAML 1.2 to plain data and keeps the position of every key and value.

Every scalar stays the text that its author wrote: the schema, not YAML, decides whether ``1.50`` is
a number or ``no`` a word. The parser accepts only the part of YAML that a rig file needs: one
document of mappings, lists and scalars. It refuses anchors, aliases, tags and merge keys, because
they could give a file another meaning than a reader sees, or make it grow when it is read.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
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

from rigd.model.errors import ConfigError, Place
from rigd.sdk.yaml.mistakes import explain

#: Mappings, lists, text, and None for a key without a value.
Data: TypeAlias = "dict[str, Data] | list[Data] | str | None"
#: The keys and list indices that lead to a value.
KeyPath: TypeAlias = tuple[str | int, ...]

#: Most bytes of a rig or procedure file: a hundred times the longest known file.
MAX_BYTES: Final = 512 * 1024
#: Deepest nesting of mappings and lists; rig and procedure files need 6 levels.
MAX_DEPTH: Final = 24
#: Texts up to this length, three times the longest known file, are kept parsed: 10 to 30 ms each.
MAX_KEPT: Final = 32 * 1024


@dataclass(frozen=True)
class Document:
    """One YAML file: its data, and the position of each key and each value."""

    path: Path
    text: str
    data: Data
    values: dict[KeyPath, Place]
    keys: dict[KeyPath, Place]

    def place(self, path: KeyPath) -> Place:
        """Return the place of the value at ``path``, or else of the nearest value around it."""
        while path not in self.values and path:
            path = path[:-1]
        return self.values[path]

    def key_place(self, path: KeyPath) -> Place:
        """Return the place of the key at ``path``, or else of its value."""
        return self.keys.get(path) or self.place(path)

    def get(self, path: KeyPath) -> Data:
        """Return the value at ``path``, or None if there is none."""
        value: Any = self.data
        for step in path:
            try:
                value = value[step]
            except (KeyError, IndexError, TypeError):
                return None
        return value  # type: ignore[no-any-return]  # data is built from Data alone

    def check_kind(self, kind: str) -> None:
        """Refuse a procedure where a rig file is wanted (``kind``), and the other way round.

        Raises:
            ConfigError: the file is of the other kind.
        """
        own, (other, telling) = {
            "rig": ("devices", ("procedure", "trial")), "procedure": ("trial", ("rig", "devices")),
        }[kind]  # fmt: skip
        has = self.data if isinstance(self.data, Mapping) else ()
        if other in has and telling in has and kind not in has and own not in has:
            raise ConfigError(
                f"this is a {other} file, and a {kind} file is wanted",
                place=self.key_place((other,)),
                hint="a rig stands behind --rig: `rigd run PROCEDURE --rig RIG`",
            )

    def inside(self, path: KeyPath, offset: int) -> Place:
        """Return the place ``offset`` characters into the text at ``path``, if it is known.

        For text that spans lines or contains escapes, the result is the place where it begins.
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
        ConfigError: the file cannot be read, is too large, is not UTF-8, or is not accepted YAML.
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
    """Return ``text`` as a document; ``path`` is the name in error messages.

    The same text and path soon after give the same document: do not change its data.

    Raises:
        ConfigError: the text is not accepted YAML.
    """
    return _parse(text, path) if len(text) > MAX_KEPT else _parse_or_recall(text, path)


def _parse(text: str, path: Path) -> Document:
    composer = _Composer(str(path))
    try:
        data = composer.compose(YAML(typ="safe", pure=True, plug_ins=[]).parse(text))
    except MarkedYAMLError as error:
        raise explain(error, text, composer.last) from error
    except ReaderError as error:
        raise ConfigError(
            f"character U+{ord(text[error.position]):04X} is not allowed in YAML",
            place=_place_of(text, error.position, str(path)), hint="remove it",
        ) from error  # fmt: skip
    # The library does not catch errors of its own code in unexpected text.
    except (
        YAMLError, ValueError, OverflowError, LookupError, AttributeError, AssertionError,
    ) as error:  # fmt: skip
        raise ConfigError(
            "the text from here on cannot be read as YAML 1.2", place=composer.last,
            hint="look for control characters and backslashes",
        ) from error  # fmt: skip
    return Document(path, text, data, composer.values, composer.keys)


_parse_or_recall: Final = lru_cache(maxsize=32)(_parse)


def _place_of(text: str, position: int, file: str) -> Place:
    head = text[:position]
    return Place(file, head.count("\n") + 1, position - head.rfind("\n"))


class _Composer:
    """Builds data from the parser's events and stores the position of each key and value."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.last = Place(file, 1, 1)
        self.values: dict[KeyPath, Place] = {}
        self.keys: dict[KeyPath, Place] = {}

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
                    raise ConfigError("the file requests a YAML version other than 1.2",
                                      place=self.last, hint="remove the %YAML line")  # fmt: skip
            elif isinstance(event, NodeEvent):
                data = self._node(event, events, ())
        if not documents or data is None:
            raise ConfigError("the file is empty", place=self.last,
                              hint="begin with 'rig: NAME' or 'procedure: NAME'")  # fmt: skip
        return data

    def _node(self, event: Event, events: Iterator[Event], path: KeyPath) -> Data:
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

    def _mapping(self, events: Iterator[Event], path: KeyPath) -> dict[str, Data]:
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
            key_path = (*path, key)
            if key == "<<":
                raise ConfigError("merge keys are not YAML 1.2", place=place,
                                  hint="write the values out")  # fmt: skip
            if key in mapping:
                raise ConfigError(
                    f"key {key!r} is given twice; first in line {self.keys[key_path].line}",
                    place=place, hint="remove one of the two",
                )  # fmt: skip
            self.keys[key_path] = place
            value = mapping[key] = self._node(next(events), events, key_path)
            if value is None:  # the parser gives no value a place: the place of the next item
                self.values[key_path] = place
        return mapping

    def _refuse_extras(self, event: Event, place: Place) -> None:
        if isinstance(event, AliasEvent) or getattr(event, "anchor", None):
            raise ConfigError(
                "anchors and aliases (& and *) are not allowed", place=place,
                hint=("write the value itself, or make it a parameter; quote text that begins "
                     "with & or *"),
            )  # fmt: skip
        if not isinstance(event, ScalarEvent | MappingStartEvent | SequenceStartEvent):
            raise ConfigError("a value is missing here", place=place)
        if event.tag is not None and str(event.tag) != "!":
            raise ConfigError("tags (!) are not allowed", place=place,
                              hint="quote text that begins with '!'")  # fmt: skip

    def _place(self, event: Event) -> Place:
        mark = event.start_mark
        return Place(self.file, mark.line + 1, mark.column + 1)


def _is_null(event: ScalarEvent) -> bool:
    return not event.style and event.value in ("~", "null", "Null", "NULL")
